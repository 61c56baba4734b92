// SPDX-License-Identifier: BSD-3-Clause
#include "depth/candidate_activation.h"

#include "base/random.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>

namespace dsorb::depth {
namespace {

constexpr int kReach = 39;

/// Smallest number of alternating steps (8 neighbours first) that covers an offset.
int stepsFor(int dx, int dy) {
  for (int k = 0; k <= kReach; ++k) {
    const int diagonal = (k + 1) / 2;
    const int straight = k / 2;
    const int rest = std::max(std::abs(dx) - diagonal, 0) + std::max(std::abs(dy) - diagonal, 0);
    if (rest <= straight) return k;
  }
  return DistanceMap::kFar;
}

TEST(DistanceMapTest, EqualsTheBruteForceDistance) {
  constexpr int kWidth = 90;
  constexpr int kHeight = 70;
  Random random(7);
  std::vector<Eigen::Vector2i> seeds;
  for (int i = 0; i < 12; ++i) {
    seeds.emplace_back(1 + static_cast<int>(random.below(kWidth - 2)),
                       1 + static_cast<int>(random.below(kHeight - 2)));
  }
  DistanceMap map(kWidth, kHeight, kReach);
  map.add(seeds);
  // Border cells are not grown from, so along the border the way may be one step longer.
  for (int y = 1; y < kHeight - 1; ++y) {
    for (int x = 1; x < kWidth - 1; ++x) {
      int expected = DistanceMap::kFar;
      for (const Eigen::Vector2i& seed : seeds) {
        expected = std::min(expected, stepsFor(x - seed.x(), y - seed.y()));
      }
      ASSERT_EQ(map.at(x, y), expected) << "at " << x << ", " << y;
    }
  }
}

TEST(DistanceMapTest, SeedsAddedOneByOneGiveTheSameMap) {
  Random random(11);
  std::vector<Eigen::Vector2i> seeds;
  for (int i = 0; i < 30; ++i) {
    seeds.emplace_back(1 + static_cast<int>(random.below(78)),
                       1 + static_cast<int>(random.below(58)));
  }
  DistanceMap together(80, 60, kReach);
  together.add(seeds);
  DistanceMap single(80, 60, kReach);
  for (const Eigen::Vector2i& seed : seeds) single.add({seed});
  for (int y = 1; y < 59; ++y) {
    for (int x = 1; x < 79; ++x) ASSERT_EQ(single.at(x, y), together.at(x, y));
  }
}

TEST(DistanceMapTest, WhatIsBeyondItsReachIsFarAway) {
  DistanceMap map(40, 40, 3);
  map.add({{20, 20}});
  EXPECT_EQ(map.at(23, 20), 3);
  EXPECT_EQ(map.at(24, 20), DistanceMap::kFar);
}

TEST(DistanceMapTest, EmptyMapIsFarAway) {
  const DistanceMap map(20, 10, kReach);
  EXPECT_EQ(map.at(3, 4), DistanceMap::kFar);
}

TEST(AdaptDistanceTest, FollowsThePublishedTable) {
  const auto change = [](double ratio) {
    return adaptDistance(2, static_cast<int>(1000 * ratio), 1000, 10) - 2;
  };
  EXPECT_NEAR(change(0.60), -1.3, 1e-12);
  EXPECT_NEAR(change(0.70), -0.5, 1e-12);
  EXPECT_NEAR(change(0.85), -0.2, 1e-12);
  EXPECT_NEAR(change(0.95), -0.1, 1e-12);
  EXPECT_NEAR(change(1.00), 0.0, 1e-12);
  EXPECT_NEAR(change(1.10), 0.1, 1e-12);
  EXPECT_NEAR(change(1.20), 0.3, 1e-12);
  EXPECT_NEAR(change(1.40), 0.8, 1e-12);
  EXPECT_NEAR(change(1.60), 1.6, 1e-12);
  EXPECT_EQ(adaptDistance(0.5, 0, 1000, 4), 0.0);
  EXPECT_EQ(adaptDistance(3.9, 5000, 1000, 4), 4.0);
}

CandidatePoint readyCandidate() {
  CandidatePoint candidate;
  candidate.status = CandidateStatus::kGood;
  candidate.min_inverse_depth = 0.9F;
  candidate.max_inverse_depth = 1.1F;
  candidate.interval = 2;
  candidate.quality = 5;
  return candidate;
}

TEST(JudgeCandidateTest, OnlyWellKnownDepthsAreReady) {
  EXPECT_EQ(judgeCandidate(readyCandidate(), false), CandidateVerdict::kReady);
  CandidatePoint candidate = readyCandidate();
  candidate.interval = 8;
  EXPECT_EQ(judgeCandidate(candidate, false), CandidateVerdict::kWait);
  EXPECT_EQ(judgeCandidate(candidate, true), CandidateVerdict::kDrop);
  candidate = readyCandidate();
  candidate.quality = 3;
  EXPECT_EQ(judgeCandidate(candidate, false), CandidateVerdict::kWait);
  candidate.finished = true;
  EXPECT_EQ(judgeCandidate(candidate, false), CandidateVerdict::kDrop);
  candidate = readyCandidate();
  candidate.status = CandidateStatus::kOutlier;
  EXPECT_EQ(judgeCandidate(candidate, false), CandidateVerdict::kDrop);
  candidate = readyCandidate();
  candidate.max_inverse_depth = CandidatePoint::kUnknown;
  EXPECT_EQ(judgeCandidate(candidate, false), CandidateVerdict::kDrop);
  candidate = readyCandidate();
  candidate.min_inverse_depth = -1.2F;  // middle behind the camera
  EXPECT_EQ(judgeCandidate(candidate, false), CandidateVerdict::kWait);
}

}  // namespace
}  // namespace dsorb::depth
