// SPDX-License-Identifier: BSD-3-Clause
#include "depth/candidate_activation.h"
#include "support/window_scene.h"

#include <benchmark/benchmark.h>

namespace dsorb::depth {
namespace {

struct Scene {
  synthetic::SyntheticSequence sequence;
  std::vector<CandidatePoint> candidates;
  FramePtr target;
  SE3 T_target_host;
  EpipolarPair pair;

  Scene()
      : sequence(synthetic::SequenceOptions()),
        target(sequence.framePtr(6)),
        T_target_host(sequence.pose(6).inverse() * sequence.pose(0)),
        pair(sequence.camera(), T_target_host, BrightnessTransfer{}) {
    const synthetic::SyntheticFrame host = sequence.frame(0);
    const FramePtr frame = sequence.framePtr(host, 0);
    for (const auto& seed : window_scene::truePoints(frame->level(0), host.inverse_depth, 12, 0)) {
      const auto candidate = makeCandidate(frame->level(0), seed.pixel, 1);
      if (candidate) candidates.push_back(*candidate);
    }
  }
};

/// New candidates: the longest searches there are.
void BM_SearchNewCandidates(benchmark::State& state) {
  const Scene scene;
  for (auto _ : state) {
    state.PauseTiming();
    std::vector<CandidatePoint> candidates = scene.candidates;
    state.ResumeTiming();
    searchEpipolarLines(candidates, scene.pair, scene.target->level(0), {});
    benchmark::DoNotOptimize(candidates.data());
  }
  state.counters["candidates"] = static_cast<double>(scene.candidates.size());
  state.counters["per_candidate"] = benchmark::Counter(
      static_cast<double>(scene.candidates.size()),
      benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}
BENCHMARK(BM_SearchNewCandidates)->Unit(benchmark::kMillisecond);

/// Candidates whose interval is short already: most of a running system's.
void BM_SearchKnownCandidates(benchmark::State& state) {
  const Scene scene;
  std::vector<CandidatePoint> known = scene.candidates;
  searchEpipolarLines(known, scene.pair, scene.target->level(0), {});
  for (auto _ : state) {
    state.PauseTiming();
    std::vector<CandidatePoint> candidates = known;
    state.ResumeTiming();
    searchEpipolarLines(candidates, scene.pair, scene.target->level(0), {});
    benchmark::DoNotOptimize(candidates.data());
  }
}
BENCHMARK(BM_SearchKnownCandidates)->Unit(benchmark::kMillisecond);

void BM_FitDepth(benchmark::State& state) {
  const Scene scene;
  std::vector<CandidatePoint> known = scene.candidates;
  searchEpipolarLines(known, scene.pair, scene.target->level(0), {});
  const HostRays rays(scene.sequence.camera());
  const std::vector<TargetImage> targets(
      4, makeTargetImage(scene.sequence.camera(), scene.T_target_host, {}, scene.target->level(0)));
  std::size_t i = 0;
  for (auto _ : state) {
    benchmark::DoNotOptimize(fitDepth(known[i], rays, targets, {}));
    if (++i == known.size()) i = 0;
  }
}
BENCHMARK(BM_FitDepth)->Unit(benchmark::kMicrosecond);

void BM_DistanceMap(benchmark::State& state) {
  Random random(1);
  std::vector<Eigen::Vector2i> seeds;
  for (int i = 0; i < 2000; ++i) {
    seeds.emplace_back(1 + static_cast<int>(random.below(318)),
                       1 + static_cast<int>(random.below(238)));
  }
  for (auto _ : state) {
    DistanceMap map(320, 240, 16);
    map.add(seeds);
    benchmark::DoNotOptimize(map.at(5, 5));
  }
}
BENCHMARK(BM_DistanceMap)->Unit(benchmark::kMillisecond);

}  // namespace
}  // namespace dsorb::depth
