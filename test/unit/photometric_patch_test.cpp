// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/photometric/photometric_equations.h"
#include "published/photometric.h"
#include "support/jacobian_check.h"
#include "support/plane_scene.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace dsorb::init_orb {
namespace {

SE3 patchPose() {
  Vector6d xi;
  xi << 0.1, -0.05, 0.08, 0.02, -0.03, 0.04;
  return SE3::exp(xi);
}

/// One patch in one frame, in double precision.
published::PatchResidual referee(const PhotometricProblem& problem,
                                 const PhotometricState& state,
                                 std::size_t frame,
                                 std::size_t patch) {
  published::PhotometricProblem same({}, problem.camera, 0);
  same.images = {problem.frames[frame].image};
  same.patches = problem.patches;
  return published::evaluatePatch(
      same, patch, 0, state.T_cam_ref[frame], state.inverse_depth[patch]);
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

Expected expectedEquations(const PhotometricProblem& problem, const PhotometricState& state) {
  constexpr int size = 6;
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
      const published::PatchResidual patch = referee(problem, state, f, p);
      for (int j = 0; j < kPatternSize; ++j) {
        const double r = patch.value[j];
        const auto root =
            static_cast<double>(problem.patches[p].root_weight[static_cast<std::size_t>(j)]);
        const double weight = root * root;
        if (!std::isfinite(r)) {
          e.cost += 0.5 * weight * 9 * 9;
          continue;
        }
        const double robust = std::min(1.0, 9 / std::abs(r));
        const double w = robust * weight;
        const Vector6d J = patch.J_pose.row(j);
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
void expectSameResiduals(const PhotometricProblem& problem, const PhotometricState& state) {
  const std::vector<FrameResiduals> residuals = residualsOf(problem, state);
  for (std::size_t f = 0; f < residuals.size(); ++f) {
    for (std::size_t i = 0; i < problem.patches.size(); i += 7) {
      const published::PatchResidual patch = referee(problem, state, f, i);
      ASSERT_EQ(residuals[f].valid[i] != 0, patch.inside) << f << " " << i;
      for (int j = 0; patch.inside && j < kPatternSize; ++j) {
        // Single precision at 255 grey levels and gradients of 20 a pixel: measured 1e-3 and below.
        EXPECT_NEAR(residuals[f].of(i)[j], patch.value[j], 0.01) << f << " " << i;
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
  PhotometricOptions options;
  options.brightness = PhotometricBrightness::kPsiFixed;
  PhotometricProblem problem = makeProblem(map, scene.camera(), options, {1, 2}, 0);
  PhotometricState state = makeState(problem, map);
  EXPECT_GT(findVisible(problem, state), 0.9);
  expectSameResiduals(problem, state);
  std::fill(problem.seen.begin(), problem.seen.end(), 1);  // clamped ones take part
  PhotometricEquations equations;
  PhotometricLinearizer(problem).linearize(state, equations);
  const Expected e = expectedEquations(problem, state);
  // Single precision: measured 2e-5 and below.
  EXPECT_NEAR(equations.cost / e.cost, 1, 1e-4);
  EXPECT_LT(relativeDifference(equations.system.H, e.hessian), 1e-4);
  EXPECT_LT(relativeDifference(equations.system.b, e.gradient), 1e-3);
  for (std::size_t i = 0; i < problem.patches.size(); i += 17) {
    const auto k = static_cast<Eigen::Index>(i);
    EXPECT_LT(relativeDifference(equations.system.couplingOf(i).cast<double>(), e.coupling.col(k)),
              1e-3);
    EXPECT_NEAR(
        equations.system.depth_hessian[i], e.depth_hessian[k], 1e-3 * e.depth_hessian[k] + 1);
    EXPECT_NEAR(equations.system.depth_gradient[i],
                e.depth_gradient[k],
                1e-3 * std::sqrt(e.depth_hessian[k]) + 1);
  }
}

}  // namespace
}  // namespace dsorb::init_orb
