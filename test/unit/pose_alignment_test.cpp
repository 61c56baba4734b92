// SPDX-License-Identifier: BSD-3-Clause
#include "track/pose_alignment.h"

#include "dsorb/camera/row_times.h"

#include "base/parallel.h"
#include "support/jacobian_check.h"
#include "support/matchers.h"
#include "support/textured_plane.h"
#include "support/tracking_reference_of.h"

#include <gtest/gtest.h>

#include <memory>
#include <vector>

namespace dsorb::track {
namespace {

SE3 smallMotion() {
  Vector6d xi;
  xi << 0.03, -0.02, 0.05, 0.01, -0.008, 0.012;
  return SE3::exp(xi);
}

/// A textured plane seen from two poses.
struct Scene {
  explicit Scene(int spacing, const AffineBrightness& affine = {}, double exposure = 1)
      : reference(referenceOf(plane.render(camera, SE3(), {FrameId{0}}),
                              camera,
                              plane.samples(camera, SE3(), spacing))),
        frame(plane.render(camera, T_cur_ref.inverse(), {FrameId{1}, 1.0, exposure}, affine)) {}
  [[nodiscard]] AlignmentLevel level(int l) const { return {reference, *frame, l}; }

  PinholeCamera camera = smallCamera();
  TexturedPlane plane;
  SE3 T_cur_ref = smallMotion();
  TrackingReference reference;
  FramePtr frame;
};

/// One point as the kernels see it: gradient and residual are given, the projection is computed.
struct OnePoint {
  float ray_x = 0.31F, ray_y = -0.22F, inverse_depth = 0.7F, intensity = 87.0F;
  float dx = 3.1F, dy = -4.7F;
  AffineBrightness reference_affine{0.1, 4.0};
  AlignmentState state{smallMotion(), {-0.2, 7.0}};

  [[nodiscard]] Eigen::Vector3d transformed(const AlignmentState& at) const {
    return at.T_cur_ref.unitQuaternion() * Eigen::Vector3d(ray_x, ray_y, 1) +
           static_cast<double>(inverse_depth) * at.T_cur_ref.translation();
  }
};

Vector14d withoutVelocity(const Eigen::VectorXd& pose_and_brightness) {
  Vector14d increment = Vector14d::Zero();
  increment.head<8>() = pose_and_brightness;
  return increment;
}

TEST(PoseAlignment, JacobianOfOnePointMatchesCentralDifferences) {
  const OnePoint point;
  const PinholeCamera camera = smallCamera();
  const Eigen::Vector2d start = camera.project(point.transformed(point.state));
  const auto residual = [&](const Eigen::VectorXd& increment) {
    const AlignmentState moved = point.state.plus(withoutVelocity(increment));
    const Eigen::Vector2d step = camera.project(point.transformed(moved)) - start;
    const BrightnessTransfer transfer =
        brightnessTransfer(point.reference_affine, 1, moved.affine, 1);
    return Eigen::VectorXd::Constant(
               1,
               static_cast<double>(point.dx) * step.x() + static_cast<double>(point.dy) * step.y() -
                   transfer.gain * static_cast<double>(point.intensity) - transfer.offset)
        .eval();
  };
  const Eigen::MatrixXd numeric = numericJacobian(residual, 8);

  AlignmentSetting setting{};
  setting.target.warp.setCamera(camera);
  setting.target.gain =
      static_cast<float>(brightnessTransfer(point.reference_affine, 1, point.state.affine, 1).gain);
  setting.affine_b_reference = static_cast<float>(point.reference_affine.b);
  const Eigen::Vector3d q = point.transformed(point.state);
  const ReferencePoints points{
      {point.ray_x}, {point.ray_y}, {point.inverse_depth}, {point.intensity}};
  const float time = -0.0125F;
  const AlignmentSamples samples{
      {static_cast<float>(q.x() / q.z())},
      {static_cast<float>(q.y() / q.z())},
      {static_cast<float>(static_cast<double>(point.inverse_depth) / q.z())},
      {point.dx},
      {point.dy},
      {1},
      {1},
      {time}};
  std::array<float, kAlignmentSums> sums{};
  accumulateBlock(setting, points, samples, {0, 1}, sums.data());
  // With residual and weight 1 the products with the residual are the Jacobian itself.
  Eigen::MatrixXd analytic(1, 8);
  std::size_t next = 0;
  for (int row = 0; row < 8; ++row) {
    next += static_cast<std::size_t>(8 - row);
    analytic(0, row) = static_cast<double>(sums[next++]);
  }
  // Single precision: measured 2e-8 for the whole row, bound of one float rounding a term.
  EXPECT_LT(relativeDifference(analytic, numeric), 1e-7) << analytic << "\n" << numeric;
  for (int i = 0; i < 8; ++i) {
    EXPECT_LT(relativeDifference(analytic.col(i), numeric.col(i)), 1e-5) << "parameter " << i;
  }
  // The velocity moves the pose by the time of the row.
  std::array<float, kRollingSums> rolling{};
  accumulateRollingBlock(setting, points, samples, {0, 1}, rolling.data());
  next = 0;
  for (int row = 0; row < kRollingParameters; ++row) {
    next += static_cast<std::size_t>(kRollingParameters - row);
    const double expected = row < kAlignmentParameters
                                ? analytic(0, row)
                                : static_cast<double>(time) * analytic(0, row - 8);
    EXPECT_NEAR(static_cast<double>(rolling[next++]), expected, 1e-6 * std::abs(expected)) << row;
  }
}

TEST(PoseAlignment, GradientOfTheEnergyMatchesCentralDifferences) {
  Scene scene(2);
  // Points that cross the image border make the energy jump: only the middle is used.
  std::vector<DepthSample> middle;
  for (const DepthSample& sample : scene.plane.samples(scene.camera, SE3(), 2)) {
    if ((sample.pixel - Eigen::Vector2f(80, 64)).cwiseAbs().maxCoeff() < 40) {
      middle.push_back(sample);
    }
  }
  scene.reference =
      referenceOf(scene.plane.render(scene.camera, SE3(), {FrameId{0}}), scene.camera, middle);
  PoseAlignment alignment;
  const AlignmentState state{scene.T_cur_ref * smallMotion(), {0.03, 2.0}};
  const Evaluation start = alignment.evaluate(scene.level(0), state);
  const PoseEquations system = alignment.normalEquations();
  const Vector8d gradient = 2 * system.b;
  for (int i = 0; i < 8; ++i) {
    const double step = i < 6 ? 1e-4 : i == 6 ? 1e-3 : 0.1;
    Vector14d increment = Vector14d::Zero();
    increment[i] = step;
    const double plus = alignment.evaluate(scene.level(0), state.plus(increment)).energy;
    const double minus = alignment.evaluate(scene.level(0), state.plus(-increment)).energy;
    const double numeric = (plus - minus) / (2 * step);
    // The scale is the largest gradient residuals of this energy could cause (Cauchy-Schwarz).
    const double scale = 2 * std::sqrt(system.H(i, i) * start.energy);
    // Gradients are interpolated central differences, not the slope of the interpolated image,
    // which jumps at every pixel: measured at most 0.0077, margin x2.
    EXPECT_NEAR(numeric / scale, gradient[i] / scale, 0.015) << "parameter " << i;
  }
}

TEST(PoseAlignment, NormalEquationsMatchADoublePrecisionSum) {
  const Scene whole(3);
  PoseAlignment alignment;
  const AlignmentState state{whole.T_cur_ref * smallMotion(), {}};
  alignment.evaluate(whole.level(0), state);
  const PoseEquations all = alignment.normalEquations();

  const ReferencePoints& points = whole.reference.at(0);
  ASSERT_NE(points.size() % kAlignmentBlock, 0U) << "the tail of the last block must be covered";
  ASSERT_GT(points.size(), 4 * kAlignmentBlock);
  Matrix8d H = Matrix8d::Zero();
  Vector8d b = Vector8d::Zero();
  const PinholeCamera& camera = whole.camera;
  const Eigen::Matrix3d R = state.T_cur_ref.rotationMatrix();
  for (std::size_t i = 0; i < points.size(); ++i) {
    const double rho = static_cast<double>(points.inverse_depth[i]);
    const Eigen::Vector3d q = R * Eigen::Vector3d(points.ray_x[i], points.ray_y[i], 1) +
                              rho * state.T_cur_ref.translation();
    const Eigen::Vector2d pixel = camera.project(q);
    const auto at = pixel.cast<float>();
    if (!canSample(whole.frame->level(0), at.x(), at.y())) continue;
    const int ix = static_cast<int>(pixel.x());
    const int iy = static_cast<int>(pixel.y());
    const double fx = pixel.x() - ix;
    const double fy = pixel.y() - iy;
    const auto mix = [&](float ImageSample::*value) {
      const PyramidLevel& image = whole.frame->level(0);
      return (1 - fy) * ((1 - fx) * static_cast<double>(image.at(ix, iy).*value) +
                         fx * static_cast<double>(image.at(ix + 1, iy).*value)) +
             fy * ((1 - fx) * static_cast<double>(image.at(ix, iy + 1).*value) +
                   fx * static_cast<double>(image.at(ix + 1, iy + 1).*value));
    };
    const double r = mix(&ImageSample::intensity) - static_cast<double>(points.intensity[i]);
    if (std::abs(r) > 20) continue;
    const double w = std::abs(r) < 9 ? 1.0 : 9 / std::abs(r);
    const double gx = camera.fx * mix(&ImageSample::dx);
    const double gy = camera.fy * mix(&ImageSample::dy);
    const double u = q.x() / q.z();
    const double v = q.y() / q.z();
    Vector8d J;
    J << rho / q.z() * gx, rho / q.z() * gy, -rho / q.z() * (u * gx + v * gy),
        -u * v * gx - (1 + v * v) * gy, (1 + u * u) * gx + u * v * gy, -v * gx + u * gy,
        -static_cast<double>(points.intensity[i]), -1;
    H += w * J * J.transpose();
    b += w * r * J;
  }
  // Single-precision terms, sums in double over blocks: measured 1.6e-7 and 1.3e-6, margin x3.
  EXPECT_LT(relativeDifference(all.H, H), 5e-7);
  EXPECT_LT(relativeDifference(all.b, b), 4e-6);
}

TEST(PoseAlignment, APointBehindTheCameraSpoilsNoEquationsOfARollingShutter) {
  const PinholeCamera camera = smallCamera();
  Lens lens{LensModel::kRadTan,
            camera.fx,
            camera.fy,
            camera.cx,
            camera.cy,
            {-0.3, 0.1},
            camera.width,
            camera.height};
  lens.readout = {0.02, 0};
  const auto rows = std::make_shared<const RowTimes>(rowTimes(lens, camera, true));
  const TexturedPlane plane;
  std::vector<DepthSample> samples = plane.samples(camera, SE3(), 3);
  samples.push_back({{20, 15}, 1000.0F, 1.0F});
  const TrackingReference reference =
      referenceOf(plane.render(camera, SE3(), {FrameId{0}}), camera, samples);
  AlignmentState state{SE3(Eigen::Matrix3d::Identity(), {0, 0, -0.02}), {}};
  state.motion.velocity << 0.1, 0, 0, 0, 0, 0.5;
  const FramePtr frame =
      plane.render(camera, state.T_cur_ref.inverse(), {FrameId{1}, 1, 1, nullptr, rows});
  PoseAlignment alignment;
  EXPECT_GT(alignment.evaluate({reference, *frame, 0}, state).used, 100);
  const RollingEquations equations = alignment.rollingEquations();
  EXPECT_TRUE(equations.H.allFinite());
  EXPECT_TRUE(equations.b.allFinite());
}

TEST(PoseAlignment, EnergyIsContinuousAtTheCutoff) {
  const PinholeCamera camera = smallCamera();
  const std::vector<float> grey(static_cast<std::size_t>(camera.width * camera.height), 100.0F);
  const FramePtr frame =
      Frame::create(ImageView(grey.data(), camera.width, camera.height), {FrameId{0}});
  const TrackingReference reference = referenceOf(frame, camera, {{{80, 60}, 0.5F, 1.0F}});
  PoseAlignment alignment;
  const AlignmentLevel level{reference, *frame, 0};
  const auto mean = [&](double residual) {
    return alignment.evaluate(level, {SE3(), {0, -residual}}).meanEnergy();
  };
  // 2 * 9 * 20 - 81 for a residual of 20 below, at and beyond the cut-off.
  EXPECT_NEAR(mean(19.9999), 279, 1e-2);
  EXPECT_NEAR(mean(20), 279, 1e-3);
  EXPECT_NEAR(mean(35), 279, 1e-3);
  EXPECT_NEAR(mean(5), 25, 1e-3);
}

TEST(PoseAlignment, SameBitsForAnyNumberOfThreads) {
  const Scene scene(1);
  ASSERT_GT(scene.reference.at(0).size(), 32 * kAlignmentBlock) << "work must be split";
  const auto run = [&](int threads) {
    TaskArena arena(threads);
    PoseAlignment alignment;
    AlignmentState state;
    arena.run([&] { return alignment.align(scene.level(0), 5, state); });
    return state;
  };
  const AlignmentState one = run(1);
  const AlignmentState two = run(2);
  EXPECT_EQ(one.T_cur_ref.matrix(), two.T_cur_ref.matrix());
  EXPECT_EQ(one.affine.a, two.affine.a);
  EXPECT_EQ(one.affine.b, two.affine.b);
}

TEST(PoseAlignment, RecoversMotionAndBrightnessTransfer) {
  const AffineBrightness truth{0.15, -8};
  const Scene scene(3, truth);
  PoseAlignment alignment;
  AlignmentState state;
  for (int l = scene.reference.levels() - 1; l >= 0; --l)
    alignment.align(scene.level(l), 50, state);
  // Interpolation lowers contrast by some 0.3 %, dilated points have their neighbour's depth.
  // Measured 0.0102 deg, 0.00038 units, 0.0026, 0.38 grey levels; margin x2.
  EXPECT_THAT(state.T_cur_ref, Se3Near(scene.T_cur_ref, 0.02, 8e-4));
  EXPECT_NEAR(state.affine.a, truth.a, 0.005);
  EXPECT_NEAR(state.affine.b, truth.b, 0.8);
}

TEST(PoseAlignment, ExposureTimesExplainBrightnessWithoutGain) {
  const Scene scene(3, {}, 0.6);
  PoseAlignment alignment;
  AlignmentState state{scene.T_cur_ref, {}};
  alignment.align(scene.level(0), 20, state);
  EXPECT_NEAR(state.affine.a, 0, 0.0026);  // measured 0.0013, margin x2
}

TEST(PoseAlignment, PerfectPhotometryFixesBrightness) {
  const Scene scene(3, {0.02, 1});
  PoseAlignment alignment(BrightnessModel::kPerfect);
  AlignmentState state;
  alignment.align(scene.level(0), 20, state);
  EXPECT_EQ(state.affine.a, 0);
  EXPECT_EQ(state.affine.b, 0);
}

TEST(PoseAlignment, WithoutAnyPointInsideTheRmseIsNotANumber) {
  const Scene scene(10);
  PoseAlignment alignment;
  AlignmentState state{SE3(Eigen::Quaterniond(0, 0, 1, 0), Eigen::Vector3d::Zero()), {}};
  const LevelResult result = alignment.align(scene.level(0), 10, state);
  EXPECT_TRUE(std::isnan(result.rmse));
  EXPECT_EQ(result.inside_fraction, 0);
}

}  // namespace
}  // namespace dsorb::track
