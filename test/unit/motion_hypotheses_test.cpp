// SPDX-License-Identifier: BSD-3-Clause
#include "estimate/pose_from_points.h"
#include "geometry/tangent_basis.h"
#include "support/jacobian_check.h"
#include "support/matchers.h"
#include "support/two_view_scene.h"
#include "two_view/essential_motion.h"
#include "two_view/model_selection.h"

#include <Eigen/LU>
#include <gtest/gtest.h>

namespace dsorb::init_orb {
namespace {

SE3 withUnitTranslation(const SE3& pose) {
  return {pose.unitQuaternion(), pose.translation().normalized()};
}

/// Rotation error and direction error [deg] of the hypothesis nearest to the truth.
double nearestErrorDeg(const std::vector<SE3>& motions, const SE3& truth) {
  double nearest = 360;
  for (const SE3& motion : motions) {
    nearest = std::min(nearest,
                       rotationErrorDeg(motion, truth) +
                           directionErrorDeg(motion.translation(), truth.translation()));
  }
  return nearest;
}

std::vector<PointObservation> observationsOf(const TwoViewScene& scene) {
  std::vector<PointObservation> observations;
  for (std::size_t i = 0; i < scene.matches.size(); ++i) {
    observations.push_back({scene.camera.unproject(scene.matches.reference[i]),
                            scene.inverse_depth[i],
                            scene.matches.target[i]});
  }
  return observations;
}

TEST(Decomposition, EssentialMatrixHoldsTheTrueMotion) {
  const TwoViewScene scene = makeTwoViewScene({}, 1);
  const Eigen::Matrix3d E = hat(scene.T_cur_ref.translation()) * scene.T_cur_ref.rotationMatrix();
  const std::vector<SE3> motions = decomposeEssential(-3 * E);
  EXPECT_EQ(motions.size(), 4U);
  EXPECT_LT(nearestErrorDeg(motions, scene.T_cur_ref), 1e-6);
}

TEST(Decomposition, HomographyHoldsTheTrueMotion) {
  const TwoViewScene scene = makeTwoViewScene({300, true}, 2);
  const Eigen::Matrix3d K = scene.camera.matrix();
  const Eigen::Vector3d normal_over_distance = Eigen::Vector3d(0.25, -0.15, 1) / 6;
  const Eigen::Matrix3d H = K *
                            (scene.T_cur_ref.rotationMatrix() +
                             scene.T_cur_ref.translation() * normal_over_distance.transpose()) *
                            K.inverse();
  const std::vector<SE3> motions = decomposeHomography(H, scene.camera);
  EXPECT_GE(motions.size(), 2U);
  EXPECT_LE(motions.size(), 4U);
  EXPECT_LT(nearestErrorDeg(motions, scene.T_cur_ref), 1e-4);
}

TEST(Decomposition, HomographyOfARotationHasNoMotion) {
  const PinholeCamera camera{450, 450, 319.5, 239.5, 640, 480};
  const Eigen::Matrix3d K = camera.matrix();
  const Eigen::Matrix3d R = so3Exp({0.05, 0.1, 0.02}).toRotationMatrix();
  EXPECT_TRUE(decomposeHomography(K * R * K.inverse(), camera).empty());
}

TEST(MotionRefinement, JacobianMatchesCentralDifferences) {
  const TwoViewScene scene = makeTwoViewScene({}, 7);
  const SE3 T = withUnitTranslation(SE3::exp(Vector6d::Constant(0.02)) * scene.T_cur_ref);
  const auto basis = tangentBasis(T.translation());
  for (std::size_t i = 0; i < 20; ++i) {
    const Eigen::Vector3d reference = scene.camera.unproject(scene.matches.reference[i]);
    const Eigen::Vector3d target = scene.camera.unproject(scene.matches.target[i]);
    const EpipolarResidual residual = epipolarResidual(T, reference, target, basis);
    // The denominator is held fixed: differentiate x_t^T [t]x R x_r alone.
    const auto algebraic = [&](const Eigen::VectorXd& step) {
      const Eigen::Vector3d t = T.translation() + basis * step.tail<2>();
      const Eigen::Quaterniond R = so3Exp(step.head<3>()) * T.unitQuaternion();
      return Eigen::VectorXd::Constant(1, target.dot(t.cross(R * reference))).eval();
    };
    const double denominator = algebraic(Eigen::VectorXd::Zero(5))[0] / residual.value;
    EXPECT_LT(relativeDifference(numericJacobian(algebraic, 5) / denominator, residual.J), 1e-6);
  }
}

TEST(MotionRefinement, ConvergesFromFiveDegreesOff) {
  const TwoViewScene scene = makeTwoViewScene({}, 8);
  Vector6d off;
  off << 0.03, -0.05, 0.02, 0.05, -0.05, 0.05;
  const SE3 start = withUnitTranslation(SE3::exp(off) * scene.T_cur_ref);
  const std::vector<char> all(scene.matches.size(), 1);
  const SE3 refined = refineMotion(start, scene.matches, all, scene.camera, 1);
  EXPECT_LT(rotationErrorDeg(refined, scene.T_cur_ref), 1e-5);
  EXPECT_LT(directionErrorDeg(refined.translation(), scene.T_cur_ref.translation()), 1e-4);
}

TEST(RotationFit, FindsTheRotationAmongOutliers) {
  const auto scene = makeTwoViewScene({300, false, {0, 0, 0}, 0.2, 0.3}, 9);
  const RotationFit fit = fitRotation(scene.matches, scene.camera);
  // Measured over 30 seeds: at most .0114 deg and .35 px.
  EXPECT_LT(rotationErrorDeg(SE3(fit.R_cur_ref, {0, 0, 0}), scene.T_cur_ref), 0.025);
  EXPECT_LT(fit.median_residual, 0.5);
}

TEST(RotationFit, LeavesTheParallaxOfATranslation) {
  // Sideways by .6 at depths 4 to 12: 22 to 67 px. Measured over 30 seeds: at least 11.2 px.
  const auto scene = makeTwoViewScene({300, false, {0.6, 0, 0}, 0, 0}, 10);
  EXPECT_GT(fitRotation(scene.matches, scene.camera).median_residual, 8);
}

TEST(PoseFromPoints, FindsThePoseDespiteOutliers) {
  const auto scene = makeTwoViewScene({200, false, {0.6, 0.1, 0.3}, 0.2, 0.2}, 11);
  const auto pose = poseFromPoints(observationsOf(scene), scene.camera, SE3(), 1);
  ASSERT_TRUE(pose);
  // Measured over 30 seeds: at most .084 deg and .018; margin x2.
  EXPECT_THAT(*pose, Se3Near(scene.T_cur_ref, 0.17, 0.036));
}

TEST(PoseFromPoints, RefusesTooFewAndContradictingObservations) {
  const auto few = makeTwoViewScene({9}, 12);
  EXPECT_FALSE(poseFromPoints(observationsOf(few), few.camera, SE3(), 1));
  const auto random = makeTwoViewScene({200, false, {0.6, 0.1, 0.3}, 0, 1.0}, 13);
  EXPECT_FALSE(poseFromPoints(observationsOf(random), random.camera, SE3(), 1));
}

}  // namespace
}  // namespace dsorb::init_orb
