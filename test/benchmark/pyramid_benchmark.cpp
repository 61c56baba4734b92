// SPDX-License-Identifier: BSD-3-Clause
#include "benchmark/rendered_frames.h"
#include "image/pixel_selector.h"

namespace dsorb {
namespace {

constexpr int kWantedPixels = 2000;  // of a keyframe

const RenderedFrames& room() {
  static const RenderedFrames frames(roomOptions(1));
  return frames;
}

const RenderedFrames& street() {
  static const RenderedFrames frames(streetOptions(1));
  return frames;
}

void frameCreate(benchmark::State& state, const RenderedFrames& (*scene)()) {
  const ImageView image = scene().images.front().view();
  timeWithThreads(state, [&] { return Frame::create(image, {FrameId{0}}); });
}
BENCHMARK_CAPTURE(frameCreate, 640x480, room)
    ->Arg(1)
    ->Arg(2)
    ->UseRealTime()
    ->MeasureProcessCPUTime();
BENCHMARK_CAPTURE(frameCreate, 1232x368, street)
    ->Arg(1)
    ->Arg(2)
    ->UseRealTime()
    ->MeasureProcessCPUTime();

void regionThresholds(benchmark::State& state, const RenderedFrames& (*scene)()) {
  const Frame& frame = *scene().frames.front();
  RegionThresholds thresholds;
  timeWithThreads(state, [&] {
    thresholds.compute(frame);
    return thresholds.squaredThreshold(0, 0);
  });
}
BENCHMARK_CAPTURE(regionThresholds, 640x480, room)->Arg(1)->UseRealTime()->MeasureProcessCPUTime();
BENCHMARK_CAPTURE(regionThresholds, 1232x368, street)
    ->Arg(1)
    ->UseRealTime()
    ->MeasureProcessCPUTime();

void pixelSelector(benchmark::State& state, const RenderedFrames& (*scene)()) {
  const Frame& frame = *scene().frames.front();
  PixelSelector selector(frame.width(), frame.height(), {});
  timeWithThreads(state, [&] { return selector.select(frame, kWantedPixels); });
}
BENCHMARK_CAPTURE(pixelSelector, 640x480, room)->Arg(1)->UseRealTime()->MeasureProcessCPUTime();
BENCHMARK_CAPTURE(pixelSelector, 1232x368, street)->Arg(1)->UseRealTime()->MeasureProcessCPUTime();

}  // namespace
}  // namespace dsorb
