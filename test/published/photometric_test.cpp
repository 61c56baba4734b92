// SPDX-License-Identifier: BSD-3-Clause
#include "published/photometric.h"

#include "base/median.h"
#include "base/random.h"
#include "support/jacobian_check.h"
#include "support/matchers.h"
#include "support/plane_scene.h"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace dsorb::published {
namespace {

/// Bilinear in x and y: interpolation and central differences are exact.
FramePtr bilinearImage() {
  std::vector<float> grey;
  for (int y = 0; y < 240; ++y) {
    for (int x = 0; x < 320; ++x) {
      grey.push_back(20 + 0.25F * static_cast<float>(x) + 0.5F * static_cast<float>(y) -
                     static_cast<float>(x * y) / 1024);
    }
  }
  return Frame::create(ImageView(grey.data(), 320, 240), {FrameId{0}});
}

struct Fixture {
  FramePtr frame = bilinearImage();
  PinholeCamera camera{200, 210, 159.5, 119.5, 320, 240};
  HostPatch patch;
  double inverse_depth = 0.8;

  Fixture() {
    patch.pixel = {179.5F, 94.3F};
    for (std::size_t j = 0; j < kPattern.size(); ++j) {
      patch.grey[j] = 60 + 6 * static_cast<float>(j * j % 7);
    }
  }
  [[nodiscard]] PatchResidual at(const Eigen::VectorXd& step) const {
    Vector6d xi;
    xi << 0.1, -0.05, 0.08, 0.02, -0.03, 0.04;
    const SE3 pose = SE3::exp(Vector6d(step.head<6>())) * SE3::exp(xi);
    Map map;
    map.frames = {{frame, SE3(), {}, {}}};
    PhotometricProblem problem(map, camera, 0);
    problem.patches = {patch};
    return evaluatePatch(problem, 0, 0, pose, inverse_depth + step[6]);
  }
  /// Grey values without psi, whose derivative the residual's leaves out.
  [[nodiscard]] Eigen::VectorXd samples(const Eigen::VectorXd& step) const {
    const PatchResidual residual = at(step);
    Eigen::VectorXd host(kPatternSize);
    for (int j = 0; j < kPatternSize; ++j) {
      host[j] = static_cast<double>(patch.grey[static_cast<std::size_t>(j)]);
    }
    return residual.value + residual.psi * host;
  }
};

TEST(PatchResidual, JacobiansMatchCentralDifferences) {
  const Fixture f;
  const PatchResidual patch = f.at(Eigen::VectorXd::Zero(7));
  ASSERT_TRUE(patch.inside);
  const Eigen::MatrixXd J =
      numericJacobian([&](const Eigen::VectorXd& step) { return f.samples(step); }, 7, 1e-5);
  EXPECT_LT(relativeDifference(patch.J_pose, J.leftCols(6)), 1e-7);
  EXPECT_LT(relativeDifference(patch.J_inverse_depth, J.col(6)), 1e-7);
}

TEST(PatchResidual, PsiIsBlindToTheContrastOfTheReference) {
  const Fixture f;
  const Eigen::VectorXd zero = Eigen::VectorXd::Zero(7);
  Fixture brighter = f;
  for (float& grey : brighter.patch.grey) grey *= 1.5F;
  EXPECT_LT((f.at(zero).value - brighter.at(zero).value).norm(), 1e-4);
}

TEST(PatchResidual, OutsideTheImageTheBorderIsRepeated) {
  Fixture f;
  f.patch.pixel = {1160, 1170};
  const PatchResidual patch = f.at(Eigen::VectorXd::Zero(7));
  EXPECT_FALSE(patch.inside);
  EXPECT_TRUE(patch.value.allFinite());
  EXPECT_EQ(patch.J_pose.norm(), 0);
  f.patch.pixel = {159.5F, 119.5F};
  f.inverse_depth = -100;  // behind the camera
  EXPECT_FALSE(f.at(Eigen::VectorXd::Zero(7)).inside);
}

/// A plane seen in later frames, with poses and depths that are off.
struct PlaneMap {
  PlaneScene scene;
  Map truth;
  Map start;

  PlaneMap(std::uint64_t seed, double noise) : scene(seed) {
    const std::vector<Eigen::Vector3d> path = {
        {0, 0, 0}, {0.06, 0.01, 0.02}, {0.13, 0.02, 0.05}, {0.2, 0.04, 0.07}};
    for (std::size_t k = 0; k < path.size(); ++k) {
      Vector6d xi;
      const double turn = 0.01 * static_cast<double>(k);
      xi << path[k], turn, -turn, 0.5 * turn;
      const SE3 pose = SE3::exp(xi);
      truth.frames.push_back({scene.render(pose, noise, static_cast<int>(k)), pose, {}, {}});
    }
    for (int y = 12; y < 228; y += 9) {
      for (int x = 12; x < 308; x += 9) {
        truth.points.push_back(
            {{static_cast<float>(x), static_cast<float>(y)}, scene.inverseDepth({x, y}), 1e-4, 3});
      }
    }
    normalizeScale(truth, truth.points.size());
    start = truth;
    Random random(seed + 77);
    for (std::size_t k = 1; k < start.frames.size(); ++k) {
      Vector6d xi;
      for (int d = 0; d < 6; ++d) xi[d] = random.uniform(-1, 1) * (d < 3 ? 0.002 : 1e-3);
      start.frames[k].T_cam_ref = SE3::exp(xi) * truth.pose(k);
    }
    for (MapPoint& point : start.points) point.inverse_depth *= 1 + 0.05 * random.uniform(-1, 1);
  }

  [[nodiscard]] std::vector<double> errors(const Map& map) const {
    std::vector<double> errors;
    for (std::size_t i = 0; i < map.points.size(); ++i) {
      errors.push_back(map.points[i].inverse_depth / truth.points[i].inverse_depth - 1);
    }
    const double median = medianOf(errors);  // the scale is free
    for (double& error : errors) error = std::abs(error - median);
    return errors;
  }
};

TEST(PhotometricBA, RecoversPosesAndDepths) {
  PlaneMap plane(3, 0);
  EXPECT_GT(medianOf(plane.errors(plane.start)), 0.02);
  Map map = plane.start;
  ASSERT_TRUE(performPhotometricBA(map, plane.scene.camera()));
  EXPECT_LT(medianOf(plane.errors(map)), 0.0066);
  EXPECT_LT(directionErrorDeg(map.pose(3).translation(), plane.truth.pose(3).translation()), 1);
  EXPECT_LT(rotationErrorDeg(map.pose(3), plane.truth.pose(3)), 0.22);
}

TEST(PhotometricBA, FailsWithoutPointsAndLeavesTheMap) {
  PlaneMap plane(4, 0);
  Map map = plane.start;
  map.points.resize(7);
  EXPECT_FALSE(performPhotometricBA(map, plane.scene.camera()));
  EXPECT_EQ(map.pose(3).matrix(), plane.start.pose(3).matrix());
}

TEST(OutlierFilter, RemovesPointsOfWrongDepthAndKeepsTheOthers) {
  PlaneMap plane(6, 2);
  Map map = plane.truth;
  for (std::size_t i = 0; i < map.points.size(); i += 10) map.points[i].inverse_depth *= 1.5;
  const std::size_t wrong = (map.points.size() + 9) / 10;
  removeOutliers(map, plane.scene.camera());
  std::size_t kept = 0;
  for (const MapPoint& point : map.points) {
    const double truth = plane.scene.inverseDepth(point.pixel.cast<double>());
    kept += point.inverse_depth / truth >
                    1.2 * map.points[1].inverse_depth /
                        plane.scene.inverseDepth(map.points[1].pixel.cast<double>())
                ? 1
                : 0;
  }
  EXPECT_LT(kept, wrong / 2);
  EXPECT_GT(map.points.size(), 0.85 * static_cast<double>(plane.truth.points.size() - wrong));
}

double drawT(Random& random) {
  double chi_square = 0;
  for (int i = 0; i < 5; ++i) chi_square += std::pow(random.gaussian(), 2);
  return random.gaussian() / std::sqrt(chi_square / 5);
}

TEST(TDistribution, RecoversTheScaleOfDrawnSamples) {
  Random random(1);
  std::vector<double> residuals;
  for (int i = 0; i < 20000; ++i) residuals.push_back(3.7 * drawT(random));
  // The prefilter cuts the tails: 5 % at 3 x 1.376 / 1.4826 scales.
  EXPECT_NEAR(fitTDistribution(residuals), 3.7, 0.4);
}

TEST(TDistribution, PrefilterSavesTheFitFromManyOutliers) {
  Random random(3);
  std::vector<double> residuals;
  for (int i = 0; i < 20000; ++i) {
    residuals.push_back(i % 5 == 0 ? random.uniform(-50, 50) : random.gaussian());
  }
  EXPECT_NEAR(fitTDistribution(residuals), 1, 0.15);  // measured 1.04
}

TEST(TDistribution, HasAScaleWhereHalfOfTheResidualsAreTheSame) {
  EXPECT_NEAR(fitTDistribution({0, 0, 0}), 0.29, 1e-6);  // of rounding
  EXPECT_EQ(fitTDistribution({}), 0);
}

}  // namespace
}  // namespace dsorb::published
