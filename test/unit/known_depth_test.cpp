// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/image/frame_priors.h"

#include "estimate/marginals.h"
#include "init/orb/bundle/reprojection_equations.h"
#include "init/orb/bundle/robust_adjustment.h"
#include "init/orb/map/depth_lookup.h"
#include "init/orb/start/known_depth_start.h"
#include "init/orb/start/known_rotations.h"
#include "support/matchers.h"
#include "support/synthetic_map.h"

#include <Eigen/LU>
#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <vector>

namespace dsorb::init_orb {
namespace {

/// Known inverse depths whose errors are `factor` times what is claimed, seen by images.
std::vector<DepthInnovation> innovations(double factor, double image_sigma, double outliers = 0) {
  constexpr double kClaimed = .01;
  std::mt19937 random(3);
  std::normal_distribution<double> noise(0, 1);
  std::uniform_real_distribution<double> uniform(0, 1);
  std::vector<DepthInnovation> all;
  for (int i = 0; i < 400; ++i) {
    double error = factor * kClaimed * noise(random) + image_sigma * noise(random);
    if (uniform(random) < outliers) error += uniform(random) - .5;
    all.push_back({error, kClaimed * kClaimed, image_sigma * image_sigma});
  }
  return all;
}

TEST(ClaimInflation, FindsWhatImagesCanTell) {
  EXPECT_EQ(claimInflation(innovations(1, .003)), 1);
  EXPECT_EQ(claimInflation(innovations(.1, .003)), 1);        // claimed too carefully
  EXPECT_NEAR(claimInflation(innovations(10, .003)), 10, 3);  // steps of 1.2, least believed one
  EXPECT_LE(claimInflation(innovations(1, .003, .05)), 1.2);
  EXPECT_EQ(claimInflation(innovations(3, 1)), 1);  // nothing to be seen in the images
}

DepthPrior twoWalls(int step) {
  constexpr int kWidth = 40;
  constexpr int kHeight = 24;
  std::vector<float> depth(static_cast<std::size_t>(kWidth) * kHeight, 0);
  for (int y = 0; y < kHeight; y += step) {
    for (int x = 0; x < kWidth; x += step) {
      depth[static_cast<std::size_t>(y * kWidth + x)] = x < 20 ? 2 : 4;
    }
  }
  return denseDepth({depth.data(), kWidth, kHeight}, 0, .01);
}

TEST(DepthLookup, IsSharpOnAWallAndWideAtItsEdge) {
  const DepthPrior prior = twoWalls(1);
  const DepthLookup lookup(prior, 1, 1);
  const KnownInverseDepth wall = lookup.at({10, 10});
  EXPECT_NEAR(wall.mean, .5, 1e-6);
  EXPECT_NEAR(std::sqrt(wall.variance), .005, 1e-6);
  EXPECT_GT(std::sqrt(lookup.at({19, 10}).variance), .08);  // of .25 and .5
  const KnownInverseDepth wide = DepthLookup(prior, 3, 10).at({10, 10});
  EXPECT_NEAR(wide.mean, 1.5, 1e-6);  // a unit is three metres
  EXPECT_NEAR(std::sqrt(wide.variance), .15, 1e-5);
}

TEST(DepthLookup, GuessesBetweenSparseOnesAndKnowsNothingFarFromThem) {
  const DepthPrior prior = twoWalls(8);
  const DepthLookup lookup(prior, 1, 1);
  EXPECT_NEAR(std::sqrt(lookup.at({8, 8}).variance), .005, 1e-6);
  const KnownInverseDepth between = lookup.at({10, 8});
  EXPECT_NEAR(between.mean, .5, 1e-6);
  EXPECT_GT(std::sqrt(between.variance), .05);  // a guess: 10 %
  std::vector<float> none(40 * 24, 0);
  none[0] = 1;
  const DepthPrior corner = denseDepth({none.data(), 40, 24}, 0, .01);
  EXPECT_FALSE(DepthLookup(corner, 1, 1).at({20, 12}));
}

TEST(KnownTerm, HasTheDerivativesOfItsCost) {
  const KnownInverseDepth known{.5, 4e-4};
  constexpr double kStep = 1e-6;
  for (const double at : {.45, .5, .51, .6, .9}) {
    const double slope =
        (knownTerm(known, at + kStep).cost - knownTerm(known, at - kStep).cost) / (2 * kStep);
    EXPECT_NEAR(knownTerm(known, at).gradient, slope, 1e-5 * std::max(1., std::abs(slope))) << at;
  }
  EXPECT_NEAR(knownTerm(known, .5).hessian, 1 / known.variance, 1e-9);
}

/// Rotations between every two frames of a map, wrong by an angle each.
std::vector<KnownRotation> rotationsOf(const InitialMap& truth, double wrong, double sigma) {
  std::vector<KnownRotation> known;
  for (std::size_t to = 1; to < truth.frames.size(); ++to) {
    const SE3 turn = *truth.frames[to].T_cam_ref * truth.frames[to - 1].T_cam_ref->inverse();
    const Eigen::Quaterniond error = so3Exp({wrong, 0, 0});
    known.push_back(
        {to - 1, to, SE3(error * turn.unitQuaternion(), Eigen::Vector3d::Zero()), sigma * sigma});
  }
  return known;
}

TEST(KnownRotations, HaveTheGradientOfTheirCost) {
  const SyntheticMap scene = makeSyntheticMap({60, 4, .3, .05}, 7);
  const GeometricOptions options;
  InitialMap map = scene.start;
  map.rotations = rotationsOf(scene.truth, .004, .003);
  const PoseRows rows(map);
  const ReprojectionEquations equations = linearize(map, rows, scene.camera, options);
  constexpr double kStep = 1e-6;
  for (std::size_t frame = 1; frame < map.frames.size(); ++frame) {
    for (int axis = 3; axis < 6; ++axis) {
      const auto costAt = [&](double step) {
        Vector6d xi = Vector6d::Zero();
        xi[axis] = step;
        const auto with = [&](InitialMap moved) {
          moved.frames[frame].T_cam_ref = SE3::exp(xi) * *map.frames[frame].T_cam_ref;
          return *reprojectionCost(moved, scene.camera, options);
        };
        InitialMap without = map;
        without.rotations.clear();
        return with(map) - with(without);  // of the rotations alone
      };
      InitialMap without = map;
      without.rotations.clear();
      const double gradient =
          (equations.system.b -
           linearize(without, rows, scene.camera, options).system.b)[rows.first[frame] + axis];
      const double slope = (costAt(kStep) - costAt(-kStep)) / (2 * kStep);
      EXPECT_NEAR(gradient, slope, .02 * std::abs(slope) + .5) << frame << " " << axis;
    }
  }
}

TEST(KnownRotations, AreTakenWhereTheyFitAndRefusedWhereTheyDoNot) {
  const SyntheticMap scene = makeSyntheticMap({150, 4, .3, .02}, 7);
  const GeometricOptions options;
  InitialMap map = scene.start;
  ASSERT_TRUE(adjustOnce(map, scene.camera, options));
  const auto error = [&](const InitialMap& of) {
    return rotationErrorDeg(*of.frames.back().T_cam_ref, *scene.truth.frames.back().T_cam_ref);
  };
  InitialMap right = map;
  ASSERT_EQ(adjustWithRotations(right, rotationsOf(scene.truth, 0, 1e-5), scene.camera, options),
            std::optional(true));
  EXPECT_LT(error(right), .2 * error(map));
  InitialMap wrong = map;
  ASSERT_EQ(adjustWithRotations(wrong, rotationsOf(scene.truth, .02, 1e-4), scene.camera, options),
            std::optional(false));
  EXPECT_TRUE(wrong.rotations.empty());
  EXPECT_EQ(error(wrong), error(map));
  EXPECT_FALSE(adjustWithRotations(wrong, {}, scene.camera, options));
}

/// Without a gauge the marginals are blocks of the inverse of the whole system.
TEST(Marginals, WithKnownScaleAreThoseOfTheWholeSystem) {
  constexpr Eigen::Index kStates = 6;
  constexpr Eigen::Index kPoints = 9;
  std::mt19937 random(5);
  std::normal_distribution<double> noise(0, 1);
  Eigen::MatrixXd J(60, kStates + kPoints);
  J.setZero();
  for (Eigen::Index row = 0; row < J.rows(); ++row) {
    for (Eigen::Index i = 0; i < kStates; ++i) J(row, i) = noise(random);
    J(row, kStates + row % kPoints) = 1 + std::abs(noise(random));
  }
  const Eigen::MatrixXd N = J.transpose() * J;
  LinearSystem<double> system;
  system.reset(kStates, 16);
  system.H = N.topLeftCorner<kStates, kStates>();
  for (Eigen::Index i = 0; i < kPoints; ++i) {
    const auto point = static_cast<std::size_t>(i);
    system.depth_hessian[point] = N(kStates + i, kStates + i);
    for (Eigen::Index k = 0; k < kStates; ++k) {
      system.coupling[point * system.stride + static_cast<std::size_t>(k)] = N(k, kStates + i);
    }
  }
  std::vector<double> inverse_depth(16, 0);
  for (std::size_t i = 0; i < kPoints; ++i) inverse_depth[i] = .5 + .1 * static_cast<double>(i);
  const Marginals marginals(system, Eigen::VectorXd::Zero(kStates), inverse_depth);
  ASSERT_TRUE(marginals.usable());
  const Eigen::MatrixXd whole = N.inverse();
  const Eigen::MatrixXd roots = marginals.inGauge(marginals.roots());
  const Eigen::MatrixXd states = whole.topLeftCorner<kStates, kStates>();
  EXPECT_LT((roots * roots.transpose() - states).norm(), 1e-9 * states.norm());
  Eigen::VectorXd effect(kStates);
  for (std::size_t i = 0; i < kPoints; ++i) {
    marginals.depthEffect(system, i, inverse_depth[i], effect);
    const double variance = marginals.ownVariance(system, i, inverse_depth[i]) +
                            (roots.transpose() * effect).squaredNorm();
    const auto at = kStates + static_cast<Eigen::Index>(i);
    EXPECT_NEAR(variance, whole(at, at), 1e-9 * whole(at, at)) << i;
  }
}

}  // namespace
}  // namespace dsorb::init_orb
