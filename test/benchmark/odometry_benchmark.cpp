// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/odometry/odometry.h"

#include "base/timed.h"
#include "benchmark/rendered_frames.h"

#include <algorithm>
#include <stdexcept>

namespace dsorb {
namespace {

constexpr int kFrames = 60;

const RenderedFrames& room() {
  static const RenderedFrames frames(roomOptions(kFrames));
  return frames;
}

const RenderedFrames& street() {
  static const RenderedFrames frames(streetOptions(kFrames));
  return frames;
}

/// Frames of a run of one sort.
struct Spent {
  double seconds = 0;
  int frames = 0;

  void add(double more) {
    seconds += more;
    ++frames;
  }
  [[nodiscard]] double mean() const { return seconds / std::max(frames, 1); }
};

/// The mean keyframe after a start, of frames that are ready: nothing is read or decoded meanwhile.
/// Counters: keyframes, and the mean milliseconds of the frames between them.
void keyframe(benchmark::State& state, const RenderedFrames& (*scene)()) {
  const RenderedFrames& rendered = scene();
  OdometryOptions options;
  options.num_threads = static_cast<int>(state.range(0));
  Spent keyframes;
  Spent between;
  for (auto _ : state) {  // NOLINT(readability-identifier-naming): the library's idiom
    keyframes = between = {};
    Odometry odometry(rendered.camera, options);
    for (const FramePtr& frame : rendered.frames) {
      double seconds = 0;
      const FrameEstimate estimate = timed(seconds, [&] { return odometry.process(frame); });
      if (estimate.state != OdometryState::kTracked) continue;
      (estimate.is_keyframe ? keyframes : between).add(seconds);
    }
    if (keyframes.frames == 0) throw std::runtime_error("no keyframe after the start");
    state.SetIterationTime(keyframes.mean());
  }
  state.counters["keyframes"] = keyframes.frames;
  state.counters["between_ms"] = 1e3 * between.mean();
}
BENCHMARK_CAPTURE(keyframe, room, room)
    ->Arg(1)
    ->Arg(2)
    ->UseManualTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(keyframe, street, street)
    ->Arg(1)
    ->Arg(2)
    ->UseManualTime()
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace dsorb
