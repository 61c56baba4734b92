// SPDX-License-Identifier: BSD-3-Clause
#include "estimate/rolling_shutter.h"

#include "support/jacobian_check.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace dsorb {
namespace {

const PinholeCamera kRowCamera{500, 500, 319.5, 239.5, 640, 480};
constexpr float kRho = 0.5F;  // [1/m]

RowTimes rowsOf(double readout) {
  Lens lens{LensModel::kPinhole, 500, 500, 319.5, 239.5, {}, 640, 480};
  lens.readout = {readout, 0};
  return rowTimes(lens, kRowCamera, false);
}

/// A hand that turns by 1 rad/s and moves by .5 m/s.
RowMotion handMotion() {
  RowMotion motion;
  motion.velocity << 0.3, -0.35, 0.2, 0.6, -0.7, 0.4;
  motion.acceleration << 1, 2, -1, 3, -2, 4;
  return motion;
}

SE3 poseAt(const RowMotion& motion, double t) {
  return SE3::exp(t * motion.velocity + 0.5 * t * t * motion.acceleration);
}

/// Pixel in the row that sees the point, exactly.
Eigen::Vector2d exactPixelInRow(const RowTimes& rows,
                                const RowMotion& motion,
                                const Eigen::Vector2d& middle,
                                double rho) {
  const Eigen::Vector3d point = kRowCamera.unproject(middle) / rho;
  Eigen::Vector2d pixel = middle;
  for (int i = 0; i < 30; ++i) {
    pixel = kRowCamera.project(poseAt(motion, rows.at(pixel.x(), pixel.y())) * point);
  }
  return pixel;
}

std::vector<Eigen::Vector2d> somePixels() {
  std::vector<Eigen::Vector2d> pixels;
  for (int y = 20; y < 480; y += 110) {
    for (int x = 30; x < 640; x += 145) pixels.emplace_back(x, y);
  }
  return pixels;
}

TEST(RollingShutter, ProjectsIntoTheRowThatSeesThePoint) {
  const RowMotion motion = handMotion();
  for (const double readout : {0.025, -0.025}) {
    const RowTimes rows = rowsOf(readout);
    const RollingShutter shutter = makeRollingShutter(rows, motion);
    double moved = 0;
    double error = 0;
    for (const Eigen::Vector2d& middle : somePixels()) {
      const Eigen::Vector2d exact =
          exactPixelInRow(rows, motion, middle, static_cast<double>(kRho));
      const Eigen::Vector2f found = pixelInRow(shutter, kRowCamera, middle.cast<float>(), kRho);
      moved = std::max(moved, (exact - middle).norm());
      error = std::max(error, (found.cast<double>() - exact).norm());
    }
    EXPECT_GT(moved, 5);
    EXPECT_LT(error, 0.015);  // measured .0102: iterations, third order in the time
  }
}

TEST(RollingShutter, HostPixelIsTheOneThatProjectsThere) {
  const RowMotion motion = handMotion();
  const RowTimes rows = rowsOf(0.025);
  const RollingShutter shutter = makeRollingShutter(rows, motion);
  for (const Eigen::Vector2d& middle : somePixels()) {
    const Eigen::Vector2d seen = exactPixelInRow(rows, motion, middle, static_cast<double>(kRho));
    const Eigen::Vector2f found = pixelInMiddle(shutter, kRowCamera, seen.cast<float>(), kRho);
    // Measured up to .0126: the inverse depth is that of the middle row, third order in the time.
    EXPECT_LT((found.cast<double>() - middle).norm(), 0.02) << middle.transpose();
  }
}

TEST(RollingShutter, SoItIsOfACarThatDrivesAhead) {
  const PinholeCamera camera{718, 718, 607, 185, 1226, 370};
  Lens lens{LensModel::kPinhole, 718, 718, 607, 185, {}, 1226, 370};
  lens.readout = {0.03, 0};
  RowMotion motion;
  motion.velocity << 0, 0, -15, 0, 0, 0;
  const RowTimes rows = rowTimes(lens, camera, false);
  const RollingShutter shutter = makeRollingShutter(rows, motion);
  const Eigen::Vector2f seen(1100, 340);
  for (const float depth : {5.0F, 10.0F, 20.0F}) {
    const Eigen::Vector2f middle = pixelInMiddle(shutter, camera, seen, 1 / depth);
    const Eigen::Vector3d point =
        static_cast<double>(depth) * camera.unproject(middle.cast<double>());
    const SE3 T_row_middle = poseAt(motion, rows.at(1100, 340));
    const Eigen::Vector2d again = camera.project(T_row_middle * point);
    // Measured .037, .0046 and .0006; with the middle row's inverse depth in the row .93, .23, .06.
    EXPECT_LT((again - seen.cast<double>()).norm(), 0.05) << depth;
  }
}

TEST(RollingShutter, LanesAndLevelsAgreeWithSinglePixels) {
  const RollingShutter fine = makeRollingShutter(rowsOf(0.025), handMotion());
  const RollingShutter coarse = makeRollingShutter(rowsOf(0.025), handMotion(), 2);
  const float at_fine = rowTime(fine, 101.5F, 201.5F);
  const float at_coarse = rowTime(coarse, 25.0F, 50.0F);  // pixels 100 to 103, 200 to 203
  EXPECT_NEAR(at_coarse, at_fine, 1e-8);
  Lanes x;
  Lanes y;
  for (int k = 0; k < kLanes; ++k) {
    x[k] = 50.0F * static_cast<float>(k);
    y[k] = 30.0F * static_cast<float>(k);
  }
  const Lanes times = rowTime(fine, x, y);
  for (int k = 0; k < kLanes; ++k) {
    const float alone = rowTime(fine, static_cast<float>(x[k]), static_cast<float>(y[k]));
    EXPECT_NEAR(times[k], alone, 1e-9);
  }
}

TEST(RollingShutter, DerivativesOfTheGlobalShutterAreCloseToItsOwn) {
  const RowMotion motion = handMotion();
  const RowTimes rows = rowsOf(0.025);
  const Eigen::Vector2d middle(500, 90);
  const Eigen::Vector3d ray = kRowCamera.unproject(middle);
  const auto seen = [&](const Vector6d& increment, double rho) {
    const Eigen::Vector3d moved = SE3::exp(increment) * Eigen::Vector3d(ray / rho);
    return exactPixelInRow(rows, motion, kRowCamera.project(moved), 1 / moved.z());
  };
  const auto projection = projectHosted(kRowCamera, SE3(), ray, static_cast<double>(kRho));
  constexpr double kStep = 1e-5;
  for (int k = 0; k < 6; ++k) {
    Vector6d increment = Vector6d::Zero();
    increment[k] = kStep;
    const Eigen::Vector2d numeric =
        (seen(increment, static_cast<double>(kRho)) - seen(-increment, static_cast<double>(kRho))) /
        (2 * kStep);
    const Eigen::Vector2d error = numeric - projection->J_pose.col(k);
    // Measured up to .0168: the rows that pass while the image moves, and its change of shape.
    EXPECT_LT(error.norm(), 0.025 * projection->J_pose.col(k).norm()) << k;
  }
}

TEST(RollingShutter, SoIsTheDerivativeByTheInverseDepth) {
  const RowMotion motion = handMotion();
  const RowTimes rows = rowsOf(0.025);
  const Eigen::Vector3d ray = kRowCamera.unproject({500, 90});
  const SE3 T_cam_host(Eigen::Quaterniond::Identity(), {0.1, 0.05, -0.02});
  const auto seen = [&](double rho) {
    const Eigen::Vector3d point = T_cam_host * Eigen::Vector3d(ray / rho);
    return exactPixelInRow(rows, motion, kRowCamera.project(point), 1 / point.z());
  };
  constexpr double kStep = 1e-5;
  const auto rho = static_cast<double>(kRho);
  const Eigen::Vector2d numeric = (seen(rho + kStep) - seen(rho - kStep)) / (2 * kStep);
  const Eigen::Vector2d global = projectHosted(kRowCamera, T_cam_host, ray, rho)->J_inverse_depth;
  EXPECT_LT((numeric - global).norm(), 0.025 * global.norm());  // measured .0163
}

TEST(RowMotion, IsTheParabolaThroughThreePoses) {
  const RowMotion motion = handMotion();
  const auto at = [&](double t) {
    return TimedPose{10 + t, poseAt(motion, t) * SE3::exp(motion.velocity)};
  };
  for (const auto& times : {std::pair(-0.033, 0.033), std::pair(-0.033, -0.066)}) {
    const RowMotion found = motionThrough(at(0), {at(times.first), at(times.second)});
    EXPECT_LT((found.velocity - motion.velocity).norm(), 1e-9);
    EXPECT_LT((found.acceleration - motion.acceleration).norm(), 1e-7);
  }
  const RowMotion one = motionThrough(at(0), {at(0), at(0.001)});
  EXPECT_LT((one.velocity - motion.velocity).norm(), 0.01);
  EXPECT_TRUE(one.acceleration.isZero(0));
  EXPECT_TRUE(motionThrough(at(0), {}).velocity.isZero(0));
}

}  // namespace
}  // namespace dsorb
