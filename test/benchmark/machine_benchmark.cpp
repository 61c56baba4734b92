// SPDX-License-Identifier: BSD-3-Clause
/// What the machine can do at most: arithmetic in registers, and reading in order and out of order.
/// docs/lab/performance.md holds the stages of the engine against it.
#include "base/lanes.h"
#include "base/random.h"
#include "base/target_clones.h"

#include <benchmark/benchmark.h>

#include <cstddef>
#include <cstdint>
#include <numeric>
#include <vector>

namespace dsorb {
namespace {

constexpr int kChains = 8;  // of dependent operations side by side: hides their latency
constexpr std::size_t kLineBytes = 64;

DSORB_TARGET_CLONES void multiplyAdd(Lanes (&sums)[kChains], const Lanes& factor, int rounds) {
  for (int i = 0; i < rounds; ++i) {
    for (Lanes& sum : sums) sum = sum * factor + factor;
  }
}

void BM_MultiplyAdd(benchmark::State& state) {
  constexpr int kRounds = 1000;
  Lanes sums[kChains] = {};
  const auto factor = spread<Lanes>(0.5F);
  for (auto _ : state) {
    multiplyAdd(sums, factor, kRounds);
    benchmark::DoNotOptimize(sums);
  }
  state.counters["operations"] = benchmark::Counter(2.0 * kLanes * kChains * kRounds,
                                                    benchmark::Counter::kIsIterationInvariantRate);
}
BENCHMARK(BM_MultiplyAdd);

DSORB_TARGET_CLONES void addUp(const float* values, std::size_t count, Lanes (&sums)[kChains]) {
  for (std::size_t i = 0; i < count; i += kLanes * kChains) {
    for (std::size_t k = 0; k < kChains; ++k) {
      sums[k] += load(values + i + k * kLanes);
    }
  }
}

/// @param state argument: bytes read again and again
void BM_ReadInOrder(benchmark::State& state) {
  const std::vector<float> values(static_cast<std::size_t>(state.range(0)) / sizeof(float), 1.0F);
  Lanes sums[kChains] = {};
  for (auto _ : state) {
    addUp(values.data(), values.size(), sums);
    benchmark::DoNotOptimize(sums);
  }
  state.SetBytesProcessed(static_cast<std::int64_t>(state.iterations()) * state.range(0));
}

/// Cache lines in random order, one value of each, as patches of a window are read.
/// @param state arguments: bytes they lie in, lines asked for ahead (0: none)
void BM_ReadLines(benchmark::State& state) {
  const auto bytes = static_cast<std::size_t>(state.range(0));
  const auto ahead = static_cast<std::size_t>(state.range(1));
  const std::vector<float> values(bytes / sizeof(float), 1.0F);
  Random random(1);
  std::vector<const float*> lines(1 << 14);
  for (const float*& line : lines) {
    const auto pick = random.below(static_cast<std::uint32_t>(bytes / kLineBytes));
    line = values.data() + pick * (kLineBytes / sizeof(float));
  }
  for (auto _ : state) {
    // Each address waits for the value before it, as a projection waits for what precedes it.
    float sum = 0;
    for (std::size_t i = 0; i + ahead < lines.size(); ++i) {
      if (ahead > 0) __builtin_prefetch(lines[i + ahead]);
      sum += lines[i][static_cast<std::size_t>(sum) & 1];
      if (sum > 1e6F) sum = 0;
    }
    benchmark::DoNotOptimize(sum);
  }
  state.counters["line"] = benchmark::Counter(
      static_cast<double>(lines.size() - ahead),
      benchmark::Counter::kIsIterationInvariantRate | benchmark::Counter::kInvert);
}

constexpr std::int64_t kKiB = 1024;
constexpr std::int64_t kMiB = 1024 * kKiB;

BENCHMARK(BM_ReadInOrder)->Arg(16 * kKiB)->Arg(512 * kKiB)->Arg(8 * kMiB)->Arg(256 * kMiB);
BENCHMARK(BM_ReadLines)
    ->ArgsProduct({{16 * kKiB, 512 * kKiB, 8 * kMiB, 40 * kMiB, 256 * kMiB}, {0, 50}});

}  // namespace
}  // namespace dsorb
