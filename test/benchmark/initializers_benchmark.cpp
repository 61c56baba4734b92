// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/init/initializer.h"

#include "benchmark/rendered_frames.h"
#include "init/orb/bundle/map_assembly.h"
#include "init/orb/semi_dense/semi_dense_depth.h"
#include "init/orb/thesis/geometric_adjustment.h"
#include "init/orb/thesis/two_view.h"
#include "init/orb/thesis/two_view_start.h"
#include "init/orb/tracks/feature_tracks.h"
#include "init/orb/two_view/decomposition.h"

#include <cstddef>
#include <stdexcept>

namespace dsorb::init_orb {
namespace {

constexpr std::uint64_t kSeed = 1;
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

CornerTracks tracksOf(const std::vector<FramePtr>& frames, const FeatureTrackOptions& options) {
  FeatureTracks tracks(options);
  tracks.start(*frames.front());
  for (std::size_t i = 1; i < frames.size(); ++i) tracks.advance(*frames[i]);
  return tracks.since(0);
}

/// What every stage of the start in the room begins with.
struct Stages {
  Stages()
      : frames(room().frames.begin(),
               room().frames.begin() +
                   static_cast<std::ptrdiff_t>(framesNeeded(optionsOf(InitializerKind::kOrb, 1)))),
        tracks(tracksOf(frames, options.tracks)),
        matches(tracks.matchesTo(tracks.frames() - 1)) {
    const TwoViewMotion motion =
        estimateMotion(matches, room().camera, options.model_choice, kSeed);
    unposed = makeInitialMap(frames, tracks, motion.best);
    triangulated = unposed;
    poseFramesBetween(triangulated, room().camera, kCornerSigma);
    adjusted = adjustGeometry(triangulated, room().camera, options.geometric).map;
  }

  OrbOptions options;
  std::vector<FramePtr> frames;
  CornerTracks tracks;
  Matches matches;
  InitialMap unposed;       // two frames posed
  InitialMap triangulated;  // all frames posed, nothing adjusted
  InitialMap adjusted;
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

void twoViewModels(benchmark::State& state) {
  const Stages& made = stages();  // outside the time
  timeWithThreads(state, [&] { return fitModels(made.matches, kSeed).homographyShare(); });
  state.counters["matches"] = static_cast<double>(made.matches.size());
}
BENCHMARK(twoViewModels)->Arg(1)->Arg(2)->UseRealTime()->MeasureProcessCPUTime();

/// Models, choice, decomposition and refinement.
void twoViewMotion(benchmark::State& state) {
  const Stages& made = stages();  // outside the time
  timeWithThreads(state, [&] {
    return estimateMotion(made.matches, room().camera, made.options.model_choice, kSeed).inliers;
  });
}
BENCHMARK(twoViewMotion)->Arg(1)->Arg(2)->UseRealTime()->MeasureProcessCPUTime();

void poseBetween(benchmark::State& state) {
  const Stages& made = stages();  // outside the time
  timeWithThreads(state, [&] {
    InitialMap map = made.unposed;
    poseFramesBetween(map, room().camera, kCornerSigma);
    return map.frames.size();
  });
}
BENCHMARK(poseBetween)->Arg(1)->UseRealTime()->MeasureProcessCPUTime();

/// The first adjustment moves everything, the second starts from the first one's result.
void geometricAdjustment(benchmark::State& state,
                         InitialMap Stages::*start,
                         AdjustmentSolver solver) {
  const Stages& made = stages();
  GeometricOptions options = made.options.geometric;
  options.solver = solver;
  GeometricReport report;
  timeWithThreads(state, [&] {
    report = adjustGeometry(made.*start, room().camera, options).report;
    return report.usable;
  });
  state.counters["corners"] = static_cast<double>((stages().*start).corners.size());
  state.counters["frames"] = static_cast<double>(stages().frames.size());
  state.counters["rounds"] = report.rounds;
  state.counters["iterations"] = report.iterations;
}
BENCHMARK_CAPTURE(geometricAdjustment, first, &Stages::triangulated, AdjustmentSolver::kSchur)
    ->Arg(1)
    ->UseRealTime()
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(geometricAdjustment, second, &Stages::adjusted, AdjustmentSolver::kSchur)
    ->Arg(1)
    ->UseRealTime()
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(geometricAdjustment, first_ceres, &Stages::triangulated, AdjustmentSolver::kCeres)
    ->Arg(1)
    ->UseRealTime()
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kMillisecond);
BENCHMARK_CAPTURE(geometricAdjustment, second_ceres, &Stages::adjusted, AdjustmentSolver::kCeres)
    ->Arg(1)
    ->UseRealTime()
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kMillisecond);

void semiDenseSearch(benchmark::State& state) {
  const Stages& made = stages();  // outside the time
  SemiDenseReport report;
  timeWithThreads(state, [&] {
    InitialMap map = made.adjusted;
    report = estimateSemiDenseDepth(map, room().camera, made.options.semi_dense, kSeed);
    return report.points;
  });
  state.counters["candidates"] = report.candidates;
  state.counters["searches"] = report.searches;
  state.counters["points"] = report.points;
}
BENCHMARK(semiDenseSearch)
    ->Arg(1)
    ->Arg(2)
    ->UseRealTime()
    ->MeasureProcessCPUTime()
    ->Unit(benchmark::kMillisecond);

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
