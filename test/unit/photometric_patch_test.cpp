// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/photometric/photometric_equations.h"
#include "init/orb/thesis/ceres/photometric_cost.h"
#include "init/orb/thesis/ceres/reprojection_cost.h"
#include "support/jacobian_check.h"
#include "support/plane_scene.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace dsorb::init_orb {
namespace {

constexpr std::array<PhotometricBrightness, 2> kModels = {PhotometricBrightness::kPsiFixed,
                                                          PhotometricBrightness::kAffine};

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

SE3 patchPose() {
  Vector6d xi;
  xi << 0.1, -0.05, 0.08, 0.02, -0.03, 0.04;
  return SE3::exp(xi);
}

HostPatch somePatch() {
  HostPatch patch;
  patch.pixel = {179.5F, 94.3F};
  for (std::size_t j = 0; j < kPattern.size(); ++j) {
    patch.grey[j] = 60 + 6 * static_cast<float>(j * j % 7);
    patch.root_weight[j] = std::sqrt(0.5F + 0.05F * static_cast<float>(j));
  }
  return patch;
}

struct Fixture {
  FramePtr frame = bilinearImage();
  PinholeCamera camera{200, 210, 159.5, 119.5, 320, 240};
  HostPatch patch = somePatch();
  double inverse_depth = 0.8;

  [[nodiscard]] PatchTarget target(const Eigen::VectorXd& step) const {
    const SE3 pose = SE3::exp(Vector6d(step.head<6>())) * patchPose();
    return {&frame->level(0),
            &camera,
            pose,
            brightnessTransfer({}, 1, {0.1 + step[6], -4 + step[7]}, 1)};
  }
  [[nodiscard]] PatchResidual at(const Eigen::VectorXd& step, PhotometricBrightness model) const {
    return evaluatePatch(patch, target(step), inverse_depth + step[8], model);
  }
};

TEST(PhotometricPatch, JacobiansMatchCentralDifferences) {
  const Fixture f;
  for (const PhotometricBrightness model : kModels) {
    const PatchResidual patch = f.at(Eigen::VectorXd::Zero(9), model);
    ASSERT_TRUE(patch.inside);
    // The psi of [Gladkova] is held constant by its derivative, but not by its value: there the
    // derivative is that of the samples alone, as with the affine model.
    const Eigen::MatrixXd J = numericJacobian(
        [&](const Eigen::VectorXd& step) {
          return Eigen::VectorXd(f.at(step, PhotometricBrightness::kAffine).residual);
        },
        9,
        1e-5);
    EXPECT_LT(relativeDifference(patch.J_pose, J.leftCols(6)), 1e-7);
    EXPECT_LT(relativeDifference(patch.J_inverse_depth, J.col(8)), 1e-7);
    if (model == PhotometricBrightness::kAffine) {
      EXPECT_LT(relativeDifference(patch.J_affine, J.middleCols(6, 2)), 1e-7);
    }
  }
}

TEST(PhotometricPatch, PsiIsBlindToTheContrastOfTheReference) {
  Fixture f;
  const Eigen::VectorXd zero = Eigen::VectorXd::Zero(9);
  Fixture brighter = f;
  for (float& grey : brighter.patch.grey) grey *= 1.5F;
  EXPECT_LT((f.at(zero, PhotometricBrightness::kPsiFixed).residual -
             brighter.at(zero, PhotometricBrightness::kPsiFixed).residual)
                .norm(),
            1e-4);
}

TEST(PhotometricPatch, OutsideTheImageTheBorderIsRepeated) {
  Fixture f;
  f.patch.pixel = {1160, 1170};
  const PatchResidual patch = f.at(Eigen::VectorXd::Zero(9), PhotometricBrightness::kAffine);
  EXPECT_FALSE(patch.inside);
  EXPECT_TRUE(patch.residual.allFinite());
  EXPECT_EQ(patch.J_pose.norm(), 0);
  f.patch.pixel = {159.5F, 119.5F};
  f.inverse_depth = -100;  // behind the camera
  EXPECT_FALSE(f.at(Eigen::VectorXd::Zero(9), PhotometricBrightness::kAffine).inside);
}

/// With the affine model: the derivative of [Gladkova] leaves psi out and is not the residuals'.
TEST(PhotometricCost, JacobiansMatchCentralDifferencesOnTheManifold) {
  Fixture f;
  const PoseManifold manifold;
  const PoseBlock pose = toBlock(patchPose());
  const auto model = PhotometricBrightness::kAffine;
  const PhotometricCost::Setting setting{f.target(Eigen::VectorXd::Zero(9)), model, 9, 1, 1};
  const PhotometricCost cost(f.patch, setting);
  const auto evaluate = [&](const Eigen::VectorXd& step, double* residuals, double** jacobians) {
    PoseBlock moved{};
    manifold.Plus(pose.data(), step.data(), moved.data());
    const std::array<double, 2> ab{0.1 + step[6], -4 + step[7]};
    const double depth = f.inverse_depth + step[8];
    const std::array<const double*, 3> parameters{moved.data(), ab.data(), &depth};
    ASSERT_TRUE(cost.Evaluate(parameters.data(), residuals, jacobians));
  };
  const Eigen::MatrixXd numeric = numericJacobian(
      [&](const Eigen::VectorXd& step) {
        Eigen::VectorXd residuals(kPatternSize);
        evaluate(step, residuals.data(), nullptr);
        return residuals;
      },
      9,
      1e-5);
  Eigen::Matrix<double, 8, 7, Eigen::RowMajor> J_pose;
  Eigen::Matrix<double, 8, 2, Eigen::RowMajor> J_affine;
  PatchVector J_depth;
  PatchVector residuals;
  std::array<double*, 3> jacobians{J_pose.data(), J_affine.data(), J_depth.data()};
  evaluate(Eigen::VectorXd::Zero(9), residuals.data(), jacobians.data());
  // The test has residuals on both sides of the Huber threshold.
  EXPECT_GT(f.at(Eigen::VectorXd::Zero(9), model).residual.lpNorm<Eigen::Infinity>(), 9);
  Eigen::Matrix<double, 7, 6, Eigen::RowMajor> plus;
  manifold.PlusJacobian(pose.data(), plus.data());
  EXPECT_LT(relativeDifference(J_pose * plus, numeric.leftCols(6)), 1e-6);
  EXPECT_LT(relativeDifference(J_affine, numeric.middleCols(6, 2)), 1e-6);
  EXPECT_LT(relativeDifference(J_depth, numeric.col(8)), 1e-6);
}

/// The equations of a few patches in two frames, in double precision.
struct Expected {
  Eigen::MatrixXd hessian;
  Eigen::VectorXd gradient;
  Eigen::MatrixXd coupling;
  Eigen::VectorXd depth_hessian;
  Eigen::VectorXd depth_gradient;
  double cost = 0;
};

Expected expectedEquations(const PhotometricProblem& problem,
                           const PhotometricState& state,
                           PhotometricBrightness model) {
  const int size = frameSize(model);
  const auto frames = static_cast<Eigen::Index>(problem.frames.size());
  const auto patches = static_cast<Eigen::Index>(problem.patches.size());
  Expected e{Eigen::MatrixXd::Zero(frames * size, frames * size),
             Eigen::VectorXd::Zero(frames * size),
             Eigen::MatrixXd::Zero(frames * size, patches),
             Eigen::VectorXd::Zero(patches),
             Eigen::VectorXd::Zero(patches)};
  for (Eigen::Index k = 0; k < frames; ++k) {
    for (Eigen::Index i = 0; i < patches; ++i) {
      const auto f = static_cast<std::size_t>(k);
      const auto p = static_cast<std::size_t>(i);
      const PatchResidual patch = evaluatePatch(
          problem.patches[p], patchTarget(problem, state, f), state.inverse_depth[p], model);
      for (int j = 0; j < kPatternSize; ++j) {
        const double r = patch.residual[j];
        const auto root =
            static_cast<double>(problem.patches[p].root_weight[static_cast<std::size_t>(j)]);
        const double weight = root * root;
        if (!std::isfinite(r)) {
          e.cost += 0.5 * weight * 9 * 9;
          continue;
        }
        const double robust = std::min(1.0, 9 / std::abs(r));
        const double w = robust * weight;
        Eigen::VectorXd J(8);
        J << patch.J_pose.row(j).transpose(), patch.J_affine.row(j).transpose();
        J.conservativeResize(size);
        e.hessian.block(k * size, k * size, size, size) += w * J * J.transpose();
        e.gradient.segment(k * size, size) += w * r * J;
        e.coupling.block(k * size, i, size, 1) += w * patch.J_inverse_depth[j] * J;
        e.depth_hessian[i] += w * patch.J_inverse_depth[j] * patch.J_inverse_depth[j];
        e.depth_gradient[i] += w * r * patch.J_inverse_depth[j];
        e.cost += 0.5 * w * r * r * (2 - robust);
      }
    }
  }
  return e;
}

/// residualsOf() against the patches one by one.
void expectSameResiduals(const PhotometricProblem& problem,
                         const PhotometricState& state,
                         PhotometricBrightness model) {
  const std::vector<FrameResiduals> residuals = residualsOf(problem, state);
  for (std::size_t f = 0; f < residuals.size(); ++f) {
    for (std::size_t i = 0; i < problem.patches.size(); i += 7) {
      const PatchResidual patch = evaluatePatch(
          problem.patches[i], patchTarget(problem, state, f), state.inverse_depth[i], model);
      ASSERT_EQ(residuals[f].valid[i] != 0, patch.inside) << f << " " << i;
      for (int j = 0; patch.inside && j < kPatternSize; ++j) {
        // Single precision at 255 grey levels and gradients of 20 a pixel: measured 1e-3 and below.
        EXPECT_NEAR(residuals[f].of(i)[j], patch.residual[j], 0.01) << f << " " << i;
      }
    }
  }
}

/// The image with an invalid square.
FramePtr withHole(const Frame& frame) {
  const PyramidLevel& image = frame.level(0);
  std::vector<float> pixels;
  for (int y = 0; y < image.height(); ++y) {
    for (int x = 0; x < image.width(); ++x) {
      const bool invalid = x >= 120 && x < 160 && y >= 100 && y < 140;
      pixels.push_back(invalid ? std::numeric_limits<float>::quiet_NaN()
                               : image.at(x, y).intensity);
    }
  }
  return Frame::create({pixels.data(), image.width(), image.height()},
                       {frame.id(), frame.timestamp(), frame.exposure(), nullptr});
}

TEST(PhotometricEquations, AreTheSumsOfThePatches) {
  const PlaneScene scene(3);
  InitialMap map;
  const SE3 twice = patchPose() * patchPose();
  map.frames = {{scene.render(SE3(), 1, 0), SE3(), {}, {}},
                {scene.render(patchPose(), 1, 1), patchPose(), {0.02, 3}, {}},
                {withHole(*scene.render(twice, 1, 2)), twice, {-0.05, 8}, {}}};
  for (int y = 50; y < 200; y += 9) {
    for (int x = 50; x < 280; x += 9) {
      SemiDensePoint point;
      point.pixel = {static_cast<float>(x), static_cast<float>(y)};
      point.inverse_depth = 1.03F * static_cast<float>(scene.inverseDepth({x, y}));
      map.points.push_back(point);
    }
  }
  for (const PhotometricBrightness model : kModels) {
    PhotometricOptions options;
    options.brightness = model;
    PhotometricProblem problem = makeProblem(map, scene.camera(), options, {1, 2}, 0);
    PhotometricState state = makeState(problem, map);
    EXPECT_GT(findVisible(problem, state), 0.9);
    expectSameResiduals(problem, state, model);
    std::fill(problem.seen.begin(), problem.seen.end(), 1);  // clamped ones take part
    PhotometricEquations equations;
    PhotometricLinearizer(problem).linearize(state, equations);
    const Expected e = expectedEquations(problem, state, model);
    // Single precision: measured 2e-5 and below.
    EXPECT_NEAR(equations.cost / e.cost, 1, 1e-4);
    EXPECT_LT(relativeDifference(equations.system.H, e.hessian), 1e-4);
    EXPECT_LT(relativeDifference(equations.system.b, e.gradient), 1e-3);
    for (std::size_t i = 0; i < problem.patches.size(); i += 17) {
      const auto k = static_cast<Eigen::Index>(i);
      EXPECT_LT(
          relativeDifference(equations.system.couplingOf(i).cast<double>(), e.coupling.col(k)),
          1e-3);
      EXPECT_NEAR(
          equations.system.depth_hessian[i], e.depth_hessian[k], 1e-3 * e.depth_hessian[k] + 1);
      EXPECT_NEAR(equations.system.depth_gradient[i],
                  e.depth_gradient[k],
                  1e-3 * std::sqrt(e.depth_hessian[k]) + 1);
    }
  }
}

}  // namespace
}  // namespace dsorb::init_orb
