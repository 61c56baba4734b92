// SPDX-License-Identifier: BSD-3-Clause
#include "base/parallel.h"

#include "base/random.h"

#include <gtest/gtest.h>

#include <cstddef>
#include <stdexcept>
#include <vector>

namespace dsorb {
namespace {

class DeterministicSum : public testing::TestWithParam<int> {};

float addUp(const std::vector<float>& values, std::size_t grain) {
  return deterministicSum(
      values.size(), grain, 0.0F, [&values](std::size_t begin, std::size_t end, float partial) {
        for (std::size_t i = begin; i < end; ++i) partial += values[i];
        return partial;
      });
}

std::vector<float> randomValues(std::size_t n) {
  Random random(3);
  std::vector<float> values(n);
  for (float& value : values) value = static_cast<float>(random.uniform(-1.0, 1.0));
  return values;
}

TEST_P(DeterministicSum, HasTheSameBitsForAnyNumberOfThreads) {
  const std::vector<float> values = randomValues(100'000);
  const float alone = TaskArena(1).run([&] { return addUp(values, 100); });
  TaskArena arena(GetParam());
  for (int i = 0; i < 20; ++i) {
    EXPECT_EQ(arena.run([&] { return addUp(values, 100); }), alone);
  }
}

INSTANTIATE_TEST_SUITE_P(Threads, DeterministicSum, testing::Values(1, 2, 4));

TEST(Parallel, SumCoversEveryItemOnceInRangesOfAtMostTheGrain) {
  const std::size_t n = 1000;
  const std::size_t grain = 7;
  std::vector<int> visits(n, 0);
  const auto count = deterministicSum(
      n, grain, std::size_t{0}, [&](std::size_t begin, std::size_t end, std::size_t partial) {
        EXPECT_LE(end - begin, grain);
        for (std::size_t i = begin; i < end; ++i) ++visits[i];
        return partial + (end - begin);
      });
  EXPECT_EQ(count, n);
  EXPECT_EQ(visits, std::vector<int>(n, 1));
}

TEST(Parallel, SumOfNothingIsZero) {
  EXPECT_EQ(
      deterministicSum(0, 5, 4, [](std::size_t, std::size_t, int partial) { return partial + 1; }),
      4);
}

TEST(Parallel, ForEachRangeCoversEveryItemOnce) {
  for (const std::size_t grain : {0U, 1U, 64U, 1000U}) {
    std::vector<int> visits(1000, 0);
    forEachRange(visits.size(), grain, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) ++visits[i];
    });
    EXPECT_EQ(visits, std::vector<int>(1000, 1)) << "grain " << grain;
  }
}

TEST(Parallel, ExceptionsOfTasksArrive) {
  EXPECT_THROW(runBoth([] {}, [] { throw std::runtime_error("second"); }), std::runtime_error);
  EXPECT_THROW(
      forEachRange(100, 1, [](std::size_t, std::size_t) { throw std::runtime_error("x"); }),
      std::runtime_error);
}

}  // namespace
}  // namespace dsorb
