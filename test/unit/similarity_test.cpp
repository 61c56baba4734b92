// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/similarity.h"

#include "dsorb/geometry/se3.h"

#include "base/random.h"

#include <gtest/gtest.h>

#include <stdexcept>
#include <vector>

namespace dsorb {
namespace {

std::vector<Eigen::Vector3d> randomPoints(std::uint64_t seed, int count) {
  Random random(seed);
  std::vector<Eigen::Vector3d> points;
  for (int i = 0; i < count; ++i) {
    points.emplace_back(random.uniform(-3, 3), random.uniform(-1, 1), random.uniform(0, 9));
  }
  return points;
}

std::vector<Eigen::Vector3d> mapped(const Similarity& to_from,
                                    const std::vector<Eigen::Vector3d>& from) {
  std::vector<Eigen::Vector3d> to;
  for (const Eigen::Vector3d& point : from) to.push_back(to_from * point);
  return to;
}

Similarity known() {
  return {2.7, so3Exp({0.4, -1.9, 0.8}).toRotationMatrix(), Eigen::Vector3d(5, -40, 7)};
}

void expectNear(const Similarity& found, const Similarity& expected, double tolerance) {
  EXPECT_NEAR(found.scale, expected.scale, tolerance);
  EXPECT_LT((found.rotation - expected.rotation).norm(), tolerance) << found.rotation;
  EXPECT_LT((found.translation - expected.translation).norm(), 20 * tolerance)
      << found.translation.transpose();
}

TEST(Similarity, IsRecoveredFromExactPoints) {
  const std::vector<Eigen::Vector3d> from = randomPoints(1, 30);
  const std::vector<Eigen::Vector3d> to = mapped(known(), from);
  const Similarity found = alignPoints(from, to);
  expectNear(found, known(), 1e-12);
  EXPECT_LT(alignmentRms(found, from, to), 1e-12);
}

TEST(Similarity, IsRecoveredFromPointsOfOnePlane) {
  std::vector<Eigen::Vector3d> from = randomPoints(2, 12);
  for (Eigen::Vector3d& point : from) point.y() = 0.3;
  expectNear(alignPoints(from, mapped(known(), from)), known(), 1e-12);
}

TEST(Similarity, NeverMirrors) {
  const std::vector<Eigen::Vector3d> from = randomPoints(3, 20);
  std::vector<Eigen::Vector3d> mirrored = from;
  for (Eigen::Vector3d& point : mirrored) point.z() = -point.z();
  EXPECT_NEAR(alignPoints(from, mirrored).rotation.determinant(), 1, 1e-12);
}

TEST(Similarity, HasTheSmallestErrorOnNoisyPoints) {
  Random random(4);
  const std::vector<Eigen::Vector3d> from = randomPoints(5, 40);
  std::vector<Eigen::Vector3d> to = mapped(known(), from);
  for (Eigen::Vector3d& point : to) {
    point += 0.1 * Eigen::Vector3d(random.gaussian(), random.gaussian(), random.gaussian());
  }
  const Similarity best = alignPoints(from, to);
  const double least = alignmentRms(best, from, to);
  for (int trial = 0; trial < 50; ++trial) {
    const auto small = [&] { return random.uniform(-1e-3, 1e-3); };
    Similarity other = best;
    other.scale *= 1 + small();
    other.rotation = so3Exp({small(), small(), small()}).toRotationMatrix() * other.rotation;
    other.translation += Eigen::Vector3d(small(), small(), small());
    EXPECT_GT(alignmentRms(other, from, to), least);
  }
}

TEST(Similarity, RefusesWhatHasNoAnswer) {
  const std::vector<Eigen::Vector3d> three = randomPoints(6, 3);
  EXPECT_THROW((void)alignPoints(three, randomPoints(6, 4)), std::invalid_argument);
  EXPECT_THROW((void)alignPoints(randomPoints(6, 2), randomPoints(6, 2)), std::invalid_argument);
  EXPECT_THROW((void)alignPoints({5, three.front()}, {5, three.front()}), std::invalid_argument);
}

}  // namespace
}  // namespace dsorb
