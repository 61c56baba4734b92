// SPDX-License-Identifier: BSD-3-Clause
#include "base/random.h"
#include "benchmark/rendered_frames.h"
#include "image/pixel_selector.h"
#include "support/tracking_reference_of.h"
#include "track/pose_alignment.h"
#include "track/tracker.h"

#include <cstddef>

namespace dsorb::track {
namespace {

constexpr int kFrames = 4;
constexpr int kSamples = 2000;        // points handed over by an initialization or a window
constexpr double kDepthError = 0.02;  // relative, of the samples
constexpr int kIterations = 10;       // of one level

const RenderedFrames& room() {
  static const RenderedFrames frames(roomOptions(kFrames));
  return frames;
}

/// Gradient pixels of the first frame with nearly true inverse depths.
std::vector<DepthSample> samples() {
  const Frame& frame = *room().frames.front();
  PixelSelector selector(frame.width(), frame.height(), {});
  Random random(1);
  std::vector<DepthSample> out;
  for (const SelectedPixel& pixel : selector.select(frame, kSamples)) {
    const auto index = static_cast<std::size_t>(pixel.y * frame.width() + pixel.x);
    const double error = 1 + kDepthError * random.gaussian();
    out.push_back({{static_cast<float>(pixel.x), static_cast<float>(pixel.y)},
                   room().inverse_depth[index] * static_cast<float>(error)});
  }
  return out;
}

void referenceConstruction(benchmark::State& state) {
  const std::vector<DepthSample> points = samples();
  TrackingReferenceBuilder builder(room().camera);
  TrackingReference reference{room().frames.front(), room().camera, {}};
  timeWithThreads(state, [&] {
    builder.fill(points, reference);
    return reference.at(0).size();
  });
}
BENCHMARK(referenceConstruction)->Arg(1)->Arg(2)->UseRealTime()->MeasureProcessCPUTime();

/// Arguments: threads, pyramid level. Starts from no motion.
void oneLevel(benchmark::State& state) {
  const TrackingReference reference = referenceOf(room().frames.front(), room().camera, samples());
  PoseAlignment alignment;
  const AlignmentLevel level{reference, *room().frames[1], static_cast<int>(state.range(1))};
  timeWithThreads(state, [&] {
    AlignmentState pose;
    return alignment.align(level, kIterations, pose).rmse;
  });
  state.counters["points"] = static_cast<double>(reference.at(level.level).size());
}
BENCHMARK(oneLevel)->ArgsProduct({{1, 2}, {0, 1, 2, 3}})->UseRealTime()->MeasureProcessCPUTime();

/// A frame with the two before it known, as in a running system.
void wholeTrack(benchmark::State& state) {
  Tracker tracker({});
  tracker.setReference(referenceOf(room().frames.front(), room().camera, samples()));
  MotionHistory history;
  for (int i = 1; i < kFrames - 1; ++i) history.push({0.1 * i, room().T_cam_first(i)});
  TrackingStart start;
  start.guesses = motionGuesses(history, 0.1 * (kFrames - 1));
  TrackingResult result;
  timeWithThreads(state, [&] {
    result = tracker.track(*room().frames.back(), start);
    return result.inside_fraction;
  });
  if (!result.good()) state.SkipWithError("the frame was not tracked");
  state.counters["hypotheses"] = result.hypotheses_tried;
}
BENCHMARK(wholeTrack)->Arg(1)->Arg(2)->UseRealTime()->MeasureProcessCPUTime();

}  // namespace
}  // namespace dsorb::track
