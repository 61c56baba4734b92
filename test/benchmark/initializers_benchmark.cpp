// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/init/initializer.h"

#include "benchmark/rendered_frames.h"
#include "features/feature_tracks.h"

#include <cstddef>
#include <stdexcept>

namespace dsorb::init_orb {
namespace {

constexpr int kFrames = 20;  // more than a start needs

const RenderedFrames& room() {
  static const RenderedFrames frames(roomOptions(kFrames));
  return frames;
}

InitializerOptions optionsOf(InitializerKind kind, int threads) {
  InitializerOptions options;
  options.kind = kind;
  options.num_threads = threads;
  return options;
}

/// Frames that an initializer needs for its start.
std::size_t framesNeeded(const InitializerOptions& options) {
  const auto initializer = makeInitializer(options, room().camera);
  for (std::size_t i = 0; i < room().frames.size(); ++i) {
    if (initializer->addFrame(room().frames[i]).result) return i + 1;
  }
  throw std::runtime_error("the room was not initialized");
}

/// Frames of the start in the room.
struct Stages {
  Stages()
      : frames(room().frames.begin(),
               room().frames.begin() +
                   static_cast<std::ptrdiff_t>(framesNeeded(optionsOf(InitializerKind::kOrb, 1)))) {
  }

  OrbOptions options;
  std::vector<FramePtr> frames;
};

const Stages& stages() {
  static const Stages made;
  return made;
}

void tracksStart(benchmark::State& state) {
  const Stages& made = stages();  // outside the time
  FeatureTracks tracks(made.options.tracks);
  timeWithThreads(state, [&] {
    tracks.start(*made.frames.front());
    return tracks.size();
  });
}
BENCHMARK(tracksStart)->Arg(1)->UseRealTime()->MeasureProcessCPUTime();

/// One step, forth and back between two frames.
void tracksAdvance(benchmark::State& state) {
  const Stages& made = stages();  // outside the time
  FeatureTracks tracks(made.options.tracks);
  tracks.start(*made.frames.front());
  std::size_t next = 1;
  timeWithThreads(state, [&] {
    tracks.advance(*made.frames[next]);
    tracks.dropFrames(0, 1);
    next = 1 - next;
    return tracks.size();
  });
  state.counters["tracks"] = tracks.size();
}
BENCHMARK(tracksAdvance)->Arg(1)->UseRealTime()->MeasureProcessCPUTime();

/// The frame that completes a start; the frames before it are fed outside the time. Counters: the
/// stages' milliseconds of the whole start.
void completingFrame(benchmark::State& state, InitializerKind kind) {
  const InitializerOptions options = optionsOf(kind, static_cast<int>(state.range(0)));
  const std::size_t needed = framesNeeded(options);
  InitStep step;
  for (auto _ : state) {  // NOLINT(readability-identifier-naming): the library's idiom
    state.PauseTiming();
    const auto initializer = makeInitializer(options, room().camera);
    for (std::size_t i = 0; i + 1 < needed; ++i) initializer->addFrame(room().frames[i]);
    state.ResumeTiming();
    step = initializer->addFrame(room().frames[needed - 1]);
  }
  state.counters["frames"] = static_cast<double>(needed);
  state.counters["points"] = static_cast<double>(step.result->points.size());
  for (const StageTime& time : step.result->report.stages) {
    state.counters[time.stage] = time.milliseconds;
  }
}
BENCHMARK_CAPTURE(completingFrame, orb, InitializerKind::kOrb)
    ->Arg(1)
    ->Arg(2)
    ->UseRealTime()
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(completingFrame, coarse, InitializerKind::kCoarse)
    ->Arg(1)
    ->Arg(2)
    ->UseRealTime()
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kMillisecond);

/// All frames of a start.
void wholeStart(benchmark::State& state, InitializerKind kind) {
  const InitializerOptions options = optionsOf(kind, static_cast<int>(state.range(0)));
  const std::size_t needed = framesNeeded(options);
  for (auto _ : state) {  // NOLINT(readability-identifier-naming): the library's idiom
    const auto initializer = makeInitializer(options, room().camera);
    for (std::size_t i = 0; i < needed; ++i) {
      benchmark::DoNotOptimize(initializer->addFrame(room().frames[i]));
    }
  }
}
BENCHMARK_CAPTURE(wholeStart, orb, InitializerKind::kOrb)
    ->Arg(2)
    ->UseRealTime()
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(wholeStart, coarse, InitializerKind::kCoarse)
    ->Arg(2)
    ->UseRealTime()
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace dsorb::init_orb
