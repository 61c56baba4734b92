// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/image/frame_priors.h"

#include "estimate/marginals.h"
#include "init/orb/bundle/reprojection_equations.h"
#include "init/orb/bundle/robust_adjustment.h"
#include "init/orb/map/initial_map.h"
#include "init/orb/start/known_motions.h"
#include "support/assign_map.h"
#include "support/matchers.h"
#include "support/synthetic_map.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <memory>
#include <optional>
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
  constexpr int kWallsWidth = 40;
  constexpr int kWallsHeight = 24;
  std::vector<float> depth(static_cast<std::size_t>(kWallsWidth) * kWallsHeight, 0);
  for (int y = 0; y < kWallsHeight; y += step) {
    for (int x = 0; x < kWallsWidth; x += step) {
      depth[static_cast<std::size_t>(y * kWallsWidth + x)] = x < 20 ? 2 : 4;
    }
  }
  return denseDepth({depth.data(), kWallsWidth, kWallsHeight}, 0, .01);
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

/// Frames' motions by truth, each since the one before, in a unit of two metres.
std::vector<KnownMotion> motionsOf(const InitialMap& truth,
                                   double wrong,
                                   double sigma,
                                   bool has_translation) {
  std::vector<KnownMotion> known;
  for (std::size_t to = 1; to < truth.frames.size(); ++to) {
    const SE3 motion = *truth.frames[to].T_cam_ref * truth.frames[to - 1].T_cam_ref->inverse();
    const Eigen::Quaterniond turn = so3Exp({wrong, 0, 0}) * motion.unitQuaternion();
    KnownMotion& one = known.emplace_back();
    one.from = to - 1;
    one.to = to;
    one.T_to_from =
        SE3(turn,
            has_translation ? Eigen::Vector3d(2 * motion.translation()) : Eigen::Vector3d(0, 0, 0));
    one.has_translation = has_translation;
    const Eigen::Index size = has_translation ? 6 : 3;
    one.information.bottomRightCorner(size, size).diagonal().setConstant(1 / (sigma * sigma));
  }
  return known;
}

/// Known motions as a system of equations sees them: the reference is no unknown.
std::vector<KnownMotion> amongUnknowns(std::vector<KnownMotion> known) {
  for (KnownMotion& one : known) {
    one.from = one.from == 0 ? KnownMotion::kReference : one.from - 1;
    --one.to;
  }
  return known;
}

std::vector<SE3> unknownPoses(const InitialMap& map) {
  std::vector<SE3> poses;
  for (std::size_t k = 1; k < map.frames.size(); ++k) poses.push_back(*map.frames[k].T_cam_ref);
  return poses;
}

class KnownMotions : public testing::TestWithParam<bool> {};
INSTANTIATE_TEST_SUITE_P(, KnownMotions, testing::Bool());

TEST_P(KnownMotions, HaveTheGradientOfTheirCost) {
  const SyntheticMap scene = makeSyntheticMap({60, 4, .3, .05}, 7);
  std::vector<KnownMotion> known = amongUnknowns(motionsOf(scene.truth, .004, .003, GetParam()));
  if (GetParam()) {  // errors of translation and rotation belong together
    for (KnownMotion& one : known) one.information(0, 4) = one.information(4, 0) = 3e4;
  }
  const std::vector<SE3> poses = unknownPoses(scene.start);
  const MotionEquations equations = motionEquations(known, poses);
  constexpr double kStep = 1e-6;
  for (Eigen::Index i = 0; i < equations.b.size(); ++i) {
    const auto costAt = [&](double step) {
      Vector6d xi = Vector6d::Zero();
      xi[i % 6] = step;
      std::vector<SE3> moved = poses;
      SE3& pose = moved[static_cast<std::size_t>(i / 6)];
      pose = SE3::exp(xi) * pose;
      return motionEquations(known, moved).cost;
    };
    const double slope = (costAt(kStep) - costAt(-kStep)) / (2 * kStep);
    // The errors' rotations are below .02 rad: their Jacobian is one up to half of that.
    EXPECT_NEAR(equations.b[i], slope, .02 * equations.b.cwiseAbs().maxCoeff()) << i;
  }
}

TEST(KnownMotionsOf, AMapLeaveItsScaleFree) {
  const SyntheticMap scene = makeSyntheticMap({60, 4, .3, .05}, 7);
  const auto known = amongUnknowns(motionsOf(scene.truth, 0, .003, true));
  const std::vector<SE3> poses = unknownPoses(scene.truth);
  const MotionEquations right = motionEquations(known, poses);
  EXPECT_NEAR(right.metres, 2, 1e-9);
  EXPECT_NEAR(right.cost, 0, 1e-9);
  Eigen::VectorXd scale = Eigen::VectorXd::Zero(right.b.size());
  std::vector<SE3> larger = unknownPoses(scene.start);
  const MotionEquations start = motionEquations(known, larger);
  for (std::size_t k = 0; k < poses.size(); ++k) {
    scale.segment<3>(static_cast<Eigen::Index>(6 * k)) = poses[k].translation();
    larger[k].setTranslation(3 * larger[k].translation());
  }
  EXPECT_LT((right.H * scale).norm(), 1e-9 * right.H.norm() * scale.norm());
  EXPECT_NEAR(motionEquations(known, larger).cost, start.cost, 1e-9 * start.cost);
  EXPECT_NEAR(motionEquations(known, larger).metres, start.metres / 3, 1e-9);
}

TEST_P(KnownMotions, AreTakenWhereTheyFitAndRefusedWhereTheyDoNot) {
  const SyntheticMap scene = makeSyntheticMap({150, 4, .3, .02}, 7);
  const GeometricOptions options;
  InitialMap map = scene.start;
  ASSERT_TRUE(assign(adjustOnce(map, scene.camera, options), map));
  const auto error = [&](const InitialMap& of) {
    return rotationErrorDeg(*of.frames.back().T_cam_ref, *scene.truth.frames.back().T_cam_ref);
  };
  const auto direction = [&](const InitialMap& of) {
    return directionErrorDeg(of.frames.back().T_cam_ref->translation(),
                             scene.truth.frames.back().T_cam_ref->translation());
  };
  const auto adjust_with = [&](InitialMap& adjusted, const std::vector<KnownMotion>& motions) {
    return adjustWithMotions(adjusted, motions, scene.camera, options);
  };
  InitialMap right = map;
  ASSERT_EQ(adjust_with(right, motionsOf(scene.truth, 0, 1e-5, GetParam())), std::optional(true));
  EXPECT_LT(error(right), .2 * error(map));
  if (GetParam()) {
    EXPECT_LT(direction(right), .2 * direction(map));
  }
  InitialMap wrong = map;
  ASSERT_EQ(adjust_with(wrong, motionsOf(scene.truth, .02, 1e-4, GetParam())),
            std::optional(false));
  EXPECT_TRUE(wrong.known_motions.empty());
  EXPECT_EQ(error(wrong), error(map));
  EXPECT_FALSE(adjust_with(wrong, {}));
}

TEST(KnownMotionsOf, AMirroredOdometryAreRefused) {
  const SyntheticMap scene = makeSyntheticMap({150, 4, .3, .02}, 7);
  InitialMap map = scene.start;
  ASSERT_TRUE(assign(adjustOnce(map, scene.camera, GeometricOptions()), map));
  std::vector<KnownMotion> known = motionsOf(scene.truth, 0, 1e-3, true);
  for (KnownMotion& one : known) {
    one.T_to_from.setTranslation(-one.T_to_from.translation());
  }
  EXPECT_EQ(adjustWithMotions(map, known, scene.camera, GeometricOptions()), std::optional(false));
}

FramePtr frameWith(int id, const std::optional<PosePrior>& motion) {
  const std::vector<std::uint8_t> pixels(64 * 64, 100);
  FrameInfo info{FrameId{id}, id * .1};
  auto priors = std::make_shared<FramePriors>();
  priors->pose = motion;
  info.priors = priors;
  return Frame::create({pixels.data(), 64, 64}, info);
}

TEST(KnownMotionsOf, AChainAddUpWithTheirCovariances) {
  const SE3 step(so3Exp({0, .1, 0}), {.2, 0, .05});
  Matrix6d covariance = Matrix6d::Identity() * 1e-4;
  covariance(0, 4) = covariance(4, 0) = 5e-5;
  std::vector<FramePtr> frames = {frameWith(0, std::nullopt)};
  for (int i = 1; i < 4; ++i)
    frames.push_back(frameWith(i, poseSince(FrameId{i - 1}, step, covariance)));
  const std::vector<KnownMotion> known = knownMotions(frames, {0, 1, 3});
  ASSERT_EQ(known.size(), 2U);
  EXPECT_EQ(known[0].from, 0U);
  EXPECT_EQ(known[1].from, 1U);
  EXPECT_EQ(known[1].to, 3U);
  const SE3 two = step * step;
  EXPECT_LT((known[1].T_to_from.matrix() - two.matrix()).norm(), 1e-12);
  // Samples of the differences of translation and rotation of disturbed chains.
  std::mt19937 random(4);
  std::normal_distribution<double> noise(0, 1);
  const Eigen::Matrix<double, 6, 6> root = Eigen::Matrix<double, 6, 6>(covariance).llt().matrixL();
  Eigen::Matrix<double, 6, 6> sampled = Eigen::Matrix<double, 6, 6>::Zero();
  constexpr int kSamples = 20000;
  const auto disturbed = [&] {
    Eigen::Matrix<double, 6, 1> z;
    for (double& value : z) value = noise(random);
    return SE3::exp(root * z) * step;
  };
  for (int i = 0; i < kSamples; ++i) {
    const SE3 chain = disturbed() * disturbed();
    Eigen::Matrix<double, 6, 1> error;
    error << chain.translation() - two.translation(),
        so3Log(chain.unitQuaternion() * two.unitQuaternion().conjugate());
    sampled += error * error.transpose() / kSamples;
  }
  const Eigen::Matrix<double, 6, 6> product = sampled * known[1].information;
  // Entries of a covariance of 20000 samples have errors of 1 %; five times that.
  EXPECT_LT((product - Eigen::Matrix<double, 6, 6>::Identity()).cwiseAbs().maxCoeff(), .05);
}

TEST(KnownMotionsOf, ABrokenChainReachNoFurther) {
  const Eigen::Matrix3d none = Eigen::Matrix3d::Identity();
  const std::vector<FramePtr> frames = {frameWith(0, std::nullopt),
                                        frameWith(1, rotationSince(FrameId{0}, none, .01)),
                                        frameWith(2, std::nullopt),
                                        frameWith(3, rotationSince(FrameId{2}, none, .01)),
                                        frameWith(4, rotationSince(FrameId{1}, none, .01))};
  const std::vector<KnownMotion> known = knownMotions(frames, {0, 3, 4});
  ASSERT_EQ(known.size(), 1U);
  EXPECT_EQ(known[0].from, 0U);
  EXPECT_EQ(known[0].to, 4U);
  EXPECT_FALSE(known[0].has_translation);
  EXPECT_NEAR(known[0].information(3, 3), 1 / 2e-4, 1e-6);
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
