// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/options/orb.h"

#include "base/random.h"
#include "benchmark/rendered_frames.h"
#include "features/feature_tracks.h"
#include "init/orb/bundle/corner_refinement.h"

#include <cstddef>

namespace dsorb::init_orb {
namespace {

constexpr std::uint64_t kSeed = 1;
constexpr int kFrames = 11;           // about what a start in the room needs
constexpr int kAdjusted = 5;          // of them, evenly spread, the newest included
constexpr double kDepthError = 0.02;  // of the inverse depths, relative
constexpr double kTrackError = 0.1;   // [px]

const RenderedFrames& room() {
  static const RenderedFrames frames(roomOptions(kFrames));
  return frames;
}

/// A map as the geometric adjustment leaves it.
struct Start {
  Start() {
    const RenderedFrames& scene = room();
    FeatureTracks tracks(options.tracks);
    tracks.start(*scene.frames.front());
    Random random(kSeed);
    for (int k = 0; k < kFrames; ++k) {
      const FramePtr& frame = scene.frames[static_cast<std::size_t>(k)];
      map.frames.push_back({frame, scene.T_cam_first(k), {}, {}});
      if (k % (kFrames / kAdjusted) != 0) map.frames.back().T_cam_ref.reset();
    }
    const CornerTracks corners = tracks.since(0);
    for (const Eigen::Vector2f& pixel : corners.positions[0])
      addCorner(pixel.cast<double>(), random);
    normalizeCornerScale(map);
  }

  void addCorner(const Eigen::Vector2d& pixel, Random& random) {
    const RenderedFrames& scene = room();
    const auto at =
        static_cast<std::size_t>(pixel.y()) * static_cast<std::size_t>(scene.camera.width) +
        static_cast<std::size_t>(pixel.x());
    const auto rho = static_cast<double>(scene.inverse_depth[at]);
    const Eigen::Vector3d point = scene.camera.unproject(pixel) / rho;
    const std::size_t corner = map.corners.size();
    const double error = kDepthError * rho;
    map.corners.push_back({pixel, rho + error * random.gaussian(), error * error});
    for (int k = 1; k < kFrames; ++k) {
      const Eigen::Vector2d noise{random.gaussian(), random.gaussian()};
      map.observations.push_back(
          {corner,
           static_cast<std::size_t>(k),
           scene.camera.project(scene.T_cam_first(k) * point) + kTrackError * noise});
    }
  }

  OrbOptions options;
  InitialMap map;
};

const Start& start() {
  static const Start made;
  return made;
}

void count(benchmark::State& state, const InitialMap& map) {
  state.counters["corners"] = static_cast<double>(map.corners.size());
}

void refine(benchmark::State& state) {
  const Start& from = start();
  timeWithThreads(state, [&] {
    InitialMap map = from.map;
    return refineCorners(map, room().camera, from.options.geometric).last_rms;
  });
  count(state, from.map);
}
BENCHMARK(refine)->Arg(1)->Arg(2)->UseRealTime()->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace dsorb::init_orb
