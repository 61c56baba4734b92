// SPDX-License-Identifier: BSD-3-Clause
#include "estimate/robust_loss.h"
#include "support/jacobian_check.h"
#include "window/normal_equations.h"

#include <gtest/gtest.h>

#include <memory>
#include <vector>

namespace dsorb::window {
namespace {

using Eigen::Vector2d;
using Eigen::VectorXd;

const PinholeCamera kCamera{210, 190, 158.3, 121.7, 320, 240};
const HostRays kRays(kCamera);

/// Intensity linear in the pixel: interpolation and gradients are exact.
FramePtr rampFrame(float offset, float dx, float dy, double exposure) {
  std::vector<float> image;
  for (int y = 0; y < kCamera.height; ++y) {
    for (int x = 0; x < kCamera.width; ++x) {
      image.push_back(offset + dx * static_cast<float>(x) + dy * static_cast<float>(y));
    }
  }
  return Frame::create(ImageView(image.data(), kCamera.width, kCamera.height),
                       {FrameId{0}, 0, exposure, nullptr});
}

/// Two keyframes with one point in the first; first estimates equal the current state.
Window makeWindow() {
  Window window(kCamera);
  WindowOptions options;
  Vector6d xi;
  xi << 0.12, -0.07, 0.05, 0.03, -0.04, 0.05;
  addKeyframe(window, rampFrame(40, 0.3F, 0.2F, 0.01), SE3::exp(0.7 * xi), {0.1, 3}, options);
  addPoint(window, window.keyframes[0], {133, 97}, 0.8F, 0);
  addKeyframe(window, rampFrame(52, 0.25F, 0.22F, 0.012), SE3::exp(-xi), {-0.05, -2}, options);
  return window;
}

/// Pixel of the point in keyframe 1 after the increments [host 6, target 6, inverse depth, camera].
Vector2d projectAfter(const Window& window, const VectorXd& d) {
  const WindowPoint& point = window.keyframes[0].points[0];
  PinholeCamera camera = window.camera();
  camera.fx += d[13];
  camera.fy += d[14];
  camera.cx += d[15];
  camera.cy += d[16];
  const SE3 host = SE3::exp(d.head<6>()) * window.keyframes[0].T_cam_world();
  const SE3 target = SE3::exp(d.segment<6>(6)) * window.keyframes[1].T_cam_world();
  const Eigen::Vector3d ray = camera.unproject(point.patch.pixel.cast<double>());
  const double rho = static_cast<double>(point.inverse_depth) + d[12];
  return camera.project(target * (host.inverse() * Eigen::Vector3d(ray / rho)));
}

TEST(PhotometricResidualTest, GeometryAgreesWithCentralDifferences) {
  const Window window = makeWindow();
  const PairTable pairs(window);
  ResidualGeometry geometry;
  ASSERT_TRUE(evaluateGeometry(
      window.keyframes[0].points[0], pairs.rays(), pairs.at(0, 1), {true, false}, geometry));
  const Eigen::MatrixXd numeric =
      numericJacobian([&](const VectorXd& d) { return VectorXd(projectAfter(window, d)); }, 17);

  using Row8 = Eigen::Map<const Eigen::Matrix<float, 8, 1>>;
  Eigen::Matrix<double, 2, 8> relative;
  relative.row(0) = Row8(geometry.x).cast<double>().transpose();
  relative.row(1) = Row8(geometry.y).cast<double>().transpose();
  const Eigen::Matrix<double, 2, 6> unscale =
      frameScale().head<6>().cwiseInverse().transpose().replicate<2, 1>();
  const Eigen::Matrix<double, 2, 6> host =
      (relative * pairs.at(0, 1).to_host.transpose()).leftCols<6>().cwiseProduct(unscale);
  const Eigen::Matrix<double, 2, 6> target =
      (relative * pairs.at(0, 1).to_target.asDiagonal()).leftCols<6>().cwiseProduct(unscale);
  Eigen::Matrix<double, 2, 4> camera;
  for (int i = 0; i < 4; ++i) {
    camera(0, i) = static_cast<double>(geometry.x[kLaneCamera + static_cast<std::size_t>(i)]);
    camera(1, i) = static_cast<double>(geometry.y[kLaneCamera + static_cast<std::size_t>(i)]);
  }
  // Single precision: measured below 5e-7, margin x20.
  EXPECT_LT(relativeDifference(host, numeric.leftCols<6>()), 1e-5);
  EXPECT_LT(relativeDifference(target, numeric.middleCols<6>(6)), 1e-5);
  EXPECT_LT(relativeDifference(Vector2d(geometry.depth_x, geometry.depth_y), numeric.col(12)),
            1e-5);
  EXPECT_LT(relativeDifference(camera / kCameraScale, numeric.rightCols<4>()), 1e-5);
}

/// The same window from a camera whose rows take 30 ms, moving as by hand.
Window makeRollingWindow() {
  Window window = makeWindow();
  Lens lens{LensModel::kPinhole, 210, 190, 158.3, 121.7, {}, 320, 240};
  lens.readout = {0.03, 0.02};
  const auto rows = std::make_shared<const RowTimes>(rowTimes(lens, kCamera, false));
  for (Keyframe& keyframe : window.keyframes) {
    FrameInfo info{keyframe.frame->id(), 0, keyframe.frame->exposure(), nullptr};
    info.row_times = rows;
    const std::vector<float> image(320UL * 240UL, 40);
    keyframe.frame = Frame::create(ImageView(image.data(), 320, 240), info);
  }
  window.keyframes[0].motion.velocity << 0.3, -0.2, 0.4, 0.9, -0.6, 0.5;
  window.keyframes[1].motion.velocity << -0.2, 0.3, 0.2, -0.4, 0.5, 0.7;
  window.keyframes[1].motion.acceleration << 1, 2, -1, 3, -2, 1;
  return window;
}

/// Pixel at which keyframe 1 shows the point, in its own row, for a change of the camera.
/// @param row of its state, in the state's units
Vector2d seenAfter(Window window, double change, int row = kReadout) {
  window.camera_state[row] += change;
  placePoints(window);
  const PairTable pairs(window);
  const WindowPoint& point = window.keyframes[0].points[0];
  const TargetImage& target = pairs.at(0, 1).current;
  const Eigen::Vector2f ray = pairs.rays().at(point.patch.pixel);
  WarpedPoint<float> p = warpPoint(target.warp, ray.x(), ray.y(), point.inverse_depth);
  moveToRow(target.shutter, target.warp, point.inverse_depth * p.inverse_z, p);
  return {p.x, p.y};
}

TEST(PhotometricResidualTest, DerivativeByTheReadoutAgreesWithDifferences) {
  Window window = makeRollingWindow();
  placePoints(window);
  const PairTable pairs(window);
  ResidualGeometry geometry;
  ASSERT_TRUE(evaluateGeometry(
      window.keyframes[0].points[0], pairs.rays(), pairs.at(0, 1), {false, true}, geometry));
  constexpr double kStep = 1e-3;
  const double scaled = kStep / kReadoutScale;
  const Vector2d numeric = (seenAfter(window, scaled) - seenAfter(window, -scaled)) / (2 * kStep);
  const Vector2d analytic(geometry.x[kLaneReadout], geometry.y[kLaneReadout]);
  ASSERT_GT(numeric.norm(), 10);  // [px/s]
  // Measured .0118: the rows that pass while the image moves.
  EXPECT_LT((analytic / kReadoutScale - numeric).norm(), 0.02 * numeric.norm());
  for (std::size_t i = kLaneCamera; i < kLaneReadout; ++i) EXPECT_EQ(geometry.x[i], 0);
}

TEST(PhotometricResidualTest, DerivativesByADistortedLensAgreeWithDifferences) {
  Window window = makeWindow();
  window.camera_state[kRadial] = -0.2 / kRadialScale;
  placePoints(window);
  const PairTable pairs(window);
  const PairGeometry& pair = pairs.at(0, 1);
  const WindowPoint& point = window.keyframes[0].points[0];
  ResidualGeometry geometry;
  ASSERT_TRUE(evaluateGeometry(point, pairs.rays(), pair, {true, false, true}, geometry));
  const Eigen::Vector3f ray =
      window.camera().unproject(point.patch.pixel.cast<double>()).cast<float>();
  const WarpedPoint<float> p = warpPoint(pair.current.warp, ray.x(), ray.y(), point.inverse_depth);
  const float ratio = pair.first.fy / pair.first.fx;
  for (const int row : {0, 1, 2, 3, kRadial}) {
    const double step = row == kRadial ? 0.3 : 1e-3;  // hundredths of a pixel
    const Vector2d numeric =
        (seenAfter(window, step, row) - seenAfter(window, -step, row)) / (2 * step);
    // What is seen moves by the derivative of the lens times the shift of a pinhole's pixel.
    const std::size_t lane = kLaneCamera + static_cast<std::size_t>(row);
    Vector2d seen;
    for (int i = 0; i < 2; ++i) {
      float dx = i == 0 ? 1.0F : 0.0F;
      float dy = 1.0F - dx;
      bendGradient(-0.2F, {p.u, p.v}, ratio, dx, dy);
      seen[i] = static_cast<double>(dx * geometry.x[lane] + dy * geometry.y[lane]);
    }
    // Measured up to .0013: single precision.
    EXPECT_LT((seen - numeric).norm(), 4e-3 * numeric.norm()) << row;
  }
}

TEST(PhotometricResidualTest, DerivativesByTheVelocitiesAgreeWithDifferences) {
  Window window = makeRollingWindow();
  placePoints(window);
  const PairTable pairs(window);
  const PairGeometry& pair = pairs.at(0, 1);
  ResidualGeometry geometry;
  ASSERT_TRUE(evaluateGeometry(window.keyframes[0].points[0], pairs.rays(), pair, {}, geometry));
  const Eigen::MatrixXd numeric = numericJacobian(
      [&](const VectorXd& d) {
        Window moved = window;
        moved.keyframes[0].motion.velocity += d.head<6>();
        moved.keyframes[1].motion.velocity += d.tail<6>();
        return VectorXd(seenAfter(moved, 0));
      },
      12,
      1e-2);
  using Row8 = Eigen::Map<const Eigen::Matrix<float, 8, 1>>;
  Eigen::Matrix<double, 2, 8> relative;
  relative.row(0) = Row8(geometry.x).cast<double>().transpose();
  relative.row(1) = Row8(geometry.y).cast<double>().transpose();
  const Eigen::Matrix<double, 2, 6> unscale =
      velocityScale().cwiseInverse().transpose().replicate<2, 1>();
  const Eigen::Matrix<double, 2, 6> host =
      static_cast<double>(geometry.host_time) *
      (relative * pair.to_host.transpose()).leftCols<6>().cwiseProduct(unscale);
  const Eigen::Matrix<double, 2, 6> target =
      static_cast<double>(geometry.target_time) *
      (relative * pair.to_target.asDiagonal()).leftCols<6>().cwiseProduct(unscale);
  ASSERT_GT(numeric.leftCols<6>().norm(), 0.3);  // [px s/rad]
  // Measured below .012: the rows that pass while the image moves, and its change of shape.
  EXPECT_LT(relativeDifference(target, numeric.rightCols<6>()), 0.02);
  // The inverse depth is that of the host's middle row: a velocity does not change it, as a pose
  // would. It is a difference along the epipolar line, which the elimination of the depths takes
  // out.
  const Vector2d across = Vector2d(geometry.depth_y, -geometry.depth_x).normalized();
  EXPECT_LT(
      relativeDifference(across.transpose() * host, across.transpose() * numeric.leftCols<6>()),
      0.02);
}

TEST(WindowTest, ReadoutIsTakenForNoneUntilItDiffersByThreeSigma) {
  Window window = makeRollingWindow();  // 30 ms, estimated
  window.readout_sigma = 0.009;
  EXPECT_FALSE(window.mayBeGlobal());
  window.readout_sigma = 0.011;
  EXPECT_TRUE(window.mayBeGlobal());
  window.camera_state[kReadout] = 0.01 / kReadoutScale;  // 40 ms
  EXPECT_FALSE(window.mayBeGlobal());
  EXPECT_FALSE(makeWindow().mayBeGlobal()) << "no readout is estimated";
}

TEST(PhotometricResidualTest, GeometryStaysAtTheFirstEstimates) {
  Window window = makeWindow();
  ResidualGeometry before;
  const WindowPoint& point = window.keyframes[0].points[0];
  ASSERT_TRUE(evaluateGeometry(point, kRays, PairTable(window).at(0, 1), {true, false}, before));
  window.keyframes[1].state.head<6>().setConstant(0.02);
  ResidualGeometry after;
  ASSERT_TRUE(evaluateGeometry(point, kRays, PairTable(window).at(0, 1), {true, false}, after));
  for (std::size_t i = 0; i < kRowLanes; ++i) EXPECT_EQ(before.x[i], after.x[i]);
  window.keyframes[1].moveFirstEstimate();
  ASSERT_TRUE(evaluateGeometry(point, kRays, PairTable(window).at(0, 1), {true, false}, after));
  EXPECT_GT(std::abs(before.x[0] - after.x[0]), 1e-4F * std::abs(before.x[0]));
}

/// Residual of one pixel of constant images, by brightness [a_host, b_host, a_target, b_target].
double brightnessResidual(const Window& window, const VectorXd& d) {
  AffineBrightness host = window.keyframes[0].affine();
  AffineBrightness target = window.keyframes[1].affine();
  host.a += d[0];
  host.b += d[1];
  target.a += d[2];
  target.b += d[3];
  const BrightnessTransfer transfer = brightnessTransfer(
      host, window.keyframes[0].frame->exposure(), target, window.keyframes[1].frame->exposure());
  const double host_intensity = static_cast<double>(window.keyframes[0].points[0].patch.grey[4]);
  return 80 - (transfer.gain * host_intensity + transfer.offset);
}

TEST(PhotometricResidualTest, BrightnessDerivativesAgreeWithCentralDifferences) {
  const Window window = makeWindow();
  const PairGeometry pair = PairTable(window).at(0, 1);
  const Eigen::MatrixXd numeric = numericJacobian(
      [&](const VectorXd& d) { return VectorXd::Constant(1, brightnessResidual(window, d)); }, 4);
  const double radiance =
      static_cast<double>(window.keyframes[0].points[0].patch.grey[4] - pair.host_offset_first);
  Eigen::RowVector4d analytic;
  analytic << pair.to_host(6, 6) * radiance / frameScale()[6], pair.to_host(7, 7) / frameScale()[7],
      pair.to_target[6] * radiance / frameScale()[6], pair.to_target[7] / frameScale()[7];
  // Measured below 1e-8 (single-precision offset), margin to 1e-6.
  EXPECT_LT(relativeDifference(analytic, numeric), 1e-6);
}

TEST(PhotometricResidualTest, SumsAgreeWithTheDefinitionPixelByPixel) {
  const Window window = makeWindow();
  const PairGeometry pair = PairTable(window).at(0, 1);
  const WindowPoint& point = window.keyframes[0].points[0];
  const PyramidLevel& level = window.keyframes[1].frame->level(0);
  PatchSums sums;
  ASSERT_TRUE(evaluatePatch(point, kRays, pair, sums));
  double energy = 0, texture = 0, xx = 0, ya = 0, br = 0;
  for (std::size_t k = 0; k < kPattern.size(); ++k) {
    const Eigen::Vector2f offset(patternX(k), patternY(k));
    const Eigen::Vector2f ray = kRays.at(point.patch.pixel + offset);
    const WarpedPoint<float> at =
        warpPoint(pair.current.warp, ray.x(), ray.y(), point.inverse_depth);
    const Sample<float> sample = interpolate(level, at.x, at.y);
    const float r =
        sample.intensity - (pair.current.gain * point.patch.grey[k] + pair.current.offset);
    const float target_weight =
        std::sqrt(gradientWeight(sample.dx * sample.dx + sample.dy * sample.dy));
    const float mean = 0.5F * (target_weight + point.patch.root_weight[k]);
    const float w = mean * mean * huberWeight(r);
    energy += static_cast<double>(w * r * r * (2 - huberWeight(r)));
    texture += static_cast<double>(w * w * (sample.dx * sample.dx + sample.dy * sample.dy));
    xx += static_cast<double>(w * sample.dx * sample.dx);
    ya += static_cast<double>(w * sample.dy * (point.patch.grey[k] - pair.host_offset_first));
    br += static_cast<double>(w * r);
  }
  // Single precision with another order of the sum.
  EXPECT_NEAR(static_cast<double>(sums.energy), energy, 1e-5 * energy);
  EXPECT_NEAR(static_cast<double>(sums.texture), texture, 1e-5 * texture);
  EXPECT_NEAR(static_cast<double>(sums.xx), xx, 1e-5 * xx);
  EXPECT_NEAR(static_cast<double>(sums.ya), ya, 1e-5 * std::abs(ya));
  EXPECT_NEAR(static_cast<double>(sums.br), br, 1e-5 * std::abs(br));
}

TEST(PhotometricResidualTest, PointsOutsideOrBehindAreRefused) {
  Window window = makeWindow();
  const WindowPoint point = window.keyframes[0].points[0];
  PatchSums sums;
  ResidualGeometry geometry;
  window.keyframes[1].state[4] = 1.0;  // 57 deg of yaw: out of sight
  EXPECT_FALSE(evaluatePatch(point, kRays, PairTable(window).at(0, 1), sums));
  window.keyframes[1].state[4] = 3.1;  // behind the camera
  window.keyframes[1].moveFirstEstimate();
  const PairTable turned(window);
  EXPECT_FALSE(evaluatePatch(point, kRays, turned.at(0, 1), sums));
  EXPECT_FALSE(evaluateGeometry(point, kRays, turned.at(0, 1), {}, geometry));
}

}  // namespace
}  // namespace dsorb::window
