// SPDX-License-Identifier: BSD-3-Clause
#include "window/normal_equations.h"

#include "base/parallel.h"
#include "support/window_scene.h"
#include "window/window_optimizer.h"
#include "window/window_step.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <ceres/ceres.h>
#include <gtest/gtest.h>

#include <array>

namespace dsorb::window {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Small window away from its optimum; depth priors hold the scale.
WindowScene perturbedScene(const WindowOptions& options, float prior_variance = 4e-4F) {
  WindowSceneOptions scene_options;
  scene_options.cell = 30;
  scene_options.prior_variance = prior_variance;
  WindowScene scene = makeWindowScene(scene_options, options);
  perturb(scene, 1e-3, 3);
  return scene;
}

WindowEquations linearized(Window& window, bool intrinsics = false) {
  NormalEquationsBuilder builder;
  WindowEquations equations;
  LinearizeOptions options;
  options.camera.intrinsics = intrinsics;
  builder.build(window, PairTable(window), allPoints(window), options, equations);
  return equations;
}

/// C^T, one row a point.
MatrixXd couplingOf(const WindowEquations& equations) {
  MatrixXd rows(static_cast<Index>(equations.points()), equations.size());
  for (Index i = 0; i < rows.rows(); ++i) {
    rows.row(i) = equations.couplingOf(static_cast<std::size_t>(i)).cast<double>().transpose();
  }
  return rows;
}

VectorXd vectorOf(const std::vector<float>& values) {
  return Eigen::Map<const Eigen::VectorXf>(values.data(), static_cast<Index>(values.size()))
      .cast<double>();
}

/// Steps of frames and intrinsics, and of the inverse depths.
std::pair<VectorXd, VectorXd> stepsOf(const Window& window,
                                      const WindowEquations& equations,
                                      const WindowOptions& options,
                                      double damping) {
  WindowElimination elimination;
  const VectorXd step = solveStep(window, equations, options, damping, elimination).change;
  std::vector<double> depths;
  elimination.substituteBack(equations, step, depths);
  return {step, Eigen::Map<const VectorXd>(depths.data(), static_cast<Index>(depths.size()))};
}

TEST(NormalEquationsTest, SchurSolveEqualsDenseSolve) {
  for (const double focal_sigma : {-1.0, 0.0, 0.1}) {
    const bool intrinsics = focal_sigma >= 0;
    WindowOptions options;
    options.optimizer.optimize_intrinsics = intrinsics;
    options.prior.focal_sigma = std::max(focal_sigma, 0.0);
    WindowScene scene = perturbedScene(options);
    const WindowEquations equations = linearized(scene.window, intrinsics);
    ASSERT_GT(equations.used, 200);
    const double damping = 0.01;
    const auto [step, depth_step] = stepsOf(scene.window, equations, options, damping);

    const StatePrior prior = statePrior(scene.window, options);
    const Index frames = scene.window.dimension();
    const auto points = static_cast<Index>(equations.points());
    MatrixXd H = MatrixXd::Zero(frames + points, frames + points);
    H.topLeftCorner(frames, frames) = equations.H;
    H.diagonal().head(frames) += prior.information;
    H.topLeftCorner<4, 4>() += prior.guess;
    H.bottomLeftCorner(points, frames) = couplingOf(equations);
    H.topRightCorner(frames, points) = couplingOf(equations).transpose();
    H.diagonal().tail(points) = vectorOf(equations.depth_hessian);
    VectorXd b(frames + points);
    b << equations.b + prior.gradient, vectorOf(equations.depth_gradient);
    H.diagonal() *= 1 + damping;
    for (Index i = 0; i < H.rows(); ++i) {  // fixed intrinsics, points without residual
      if (H(i, i) == 0) H(i, i) = 1;
    }
    const VectorXd scale = H.diagonal().cwiseSqrt().cwiseInverse();
    const MatrixXd scaled = scale.asDiagonal() * H * scale.asDiagonal();
    const VectorXd dense = -(scale.asDiagonal() * scaled.ldlt().solve(scale.asDiagonal() * b));
    EXPECT_LT((dense.head(frames) - step).norm(), 1e-8 * step.norm());
    EXPECT_LT((dense.tail(points) - depth_step).norm(), 1e-8 * depth_step.norm());
  }
}

TEST(StatePriorTest, GradientOfAGuessedCameraIsThatOfItsEnergy) {
  WindowOptions options;
  options.optimizer.optimize_intrinsics = true;
  options.prior.focal_sigma = 0.15;
  WindowScene scene = perturbedScene(options);
  Window& window = scene.window;
  window.camera_state.head<4>() << 0.3, -0.2, 0.1, 0.4;
  const StatePrior prior = statePrior(window, options);
  constexpr double kStep = 1e-4;
  for (Index i = 0; i < kIntrinsicsDim; ++i) {
    const auto energy_at = [&](double step) {
      Window moved = window;
      moved.camera_state[i] += step;
      return statePrior(moved, options).energy;
    };
    const double numeric = (energy_at(kStep) - energy_at(-kStep)) / (2 * kStep);
    EXPECT_NEAR(2 * prior.gradient[i], numeric, 1e-6 * std::abs(numeric));
  }
  // Both focal lengths by the same share is what the guess leaves open, their ratio is not.
  const PinholeCamera& camera = window.first_camera;
  const Eigen::Vector4d together(camera.fx, camera.fy, 0, 0), apart(camera.fx, -camera.fy, 0, 0);
  EXPECT_LT(100 * together.dot(prior.guess * together), apart.dot(prior.guess * apart));
}

TEST(StatePriorTest, ACameraThatWasFoundHoldsAsAWhole) {
  WindowOptions options;
  options.optimizer.optimize_intrinsics = true;
  options.prior.focal_sigma = 0.15;
  const WindowScene scene = perturbedScene(options);
  const StatePrior guessed = statePrior(scene.window, options);
  options.prior.focal_sigma /= 10;
  const StatePrior found = statePrior(scene.window, options);
  EXPECT_TRUE(found.guess.isApprox(100 * guessed.guess, 1e-9));
  EXPECT_NEAR(found.information[kRadial], 100 * guessed.information[kRadial], 1e-6);
  options.prior.focal_sigma = 0.5;  // the field of view is less known; phones are as they are
  const StatePrior unknown = statePrior(scene.window, options);
  EXPECT_DOUBLE_EQ(unknown.guess(2, 2), guessed.guess(2, 2));
  EXPECT_DOUBLE_EQ(unknown.information[kRadial], guessed.information[kRadial]);
}

/// One residual of the window with the same quadratic energy in 4 whitened residuals: square root
/// of the patch block times the relative Jacobian.
class PatchCost : public ceres::SizedCostFunction<4, 8, 8, 1> {
 public:
  PatchCost(const PatchSums& p, const ResidualGeometry& g, const PairGeometry& pair) {
    Eigen::Matrix4d M;
    M << p.xx, p.xy, p.xa, p.xb, p.xy, p.yy, p.ya, p.yb, p.xa, p.ya, p.aa, p.ab, p.xb, p.yb, p.ab,
        p.bb;
    const Eigen::Vector4d rhs(p.xr, p.yr, p.ar, p.br);
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix4d> eigen(M);
    const Eigen::Vector4d root = eigen.eigenvalues().cwiseMax(1e-9).cwiseSqrt();
    const Eigen::Matrix4d A = root.asDiagonal() * eigen.eigenvectors().transpose();
    residual_ = root.cwiseInverse().asDiagonal() * eigen.eigenvectors().transpose() * rhs;
    Eigen::Matrix<double, 4, 8> relative = Eigen::Matrix<double, 4, 8>::Zero();
    for (Index i = 0; i < 6; ++i) {
      relative(0, i) = static_cast<double>(g.x[i]);
      relative(1, i) = static_cast<double>(g.y[i]);
    }
    relative(2, 6) = 1;
    relative(3, 7) = 1;
    J_host_ = A * relative * pair.to_host.transpose();
    J_target_ = A * relative * pair.to_target.asDiagonal();
    J_depth_ = A * Eigen::Vector4d(g.depth_x, g.depth_y, 0, 0);
  }

  bool Evaluate(double const* const* x, double* residuals, double** jacobians) const override {
    using Step = Eigen::Map<const Vector8d>;
    Eigen::Map<Eigen::Vector4d>{residuals} =
        residual_ + J_host_ * Step(x[0]) + J_target_ * Step(x[1]) + J_depth_ * x[2][0];
    if (jacobians == nullptr) return true;
    using Out = Eigen::Map<Eigen::Matrix<double, 4, 8, Eigen::RowMajor>>;
    if (jacobians[0] != nullptr) Out{jacobians[0]} = J_host_;
    if (jacobians[1] != nullptr) Out{jacobians[1]} = J_target_;
    if (jacobians[2] != nullptr) Eigen::Map<Eigen::Vector4d>{jacobians[2]} = J_depth_;
    return true;
  }

 private:
  Eigen::Vector4d residual_;
  Eigen::Matrix<double, 4, 8> J_host_;
  Eigen::Matrix<double, 4, 8> J_target_;
  Eigen::Vector4d J_depth_;
};

/// sqrt(information) * (value + step), element by element.
class PriorCost : public ceres::CostFunction {
 public:
  PriorCost(const VectorXd& information, const VectorXd& value)
      : root_(information.cwiseSqrt()), value_(value) {
    set_num_residuals(static_cast<int>(value.size()));
    mutable_parameter_block_sizes()->push_back(static_cast<int>(value.size()));
  }
  bool Evaluate(double const* const* x, double* residuals, double** jacobians) const override {
    const Index n = value_.size();
    Eigen::Map<VectorXd>(residuals, n) =
        root_.cwiseProduct(value_ + Eigen::Map<const VectorXd>(x[0], n));
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      Eigen::Map<Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>(
          jacobians[0], n, n) = MatrixXd(root_.asDiagonal());
    }
    return true;
  }

 private:
  VectorXd root_;
  VectorXd value_;
};

/// The same step from Ceres.
struct CeresStep {
  std::vector<std::array<double, 8>> frames;
  std::vector<double> depths;
};

CeresStep solveWithCeres(const Window& window) {
  const PairTable pairs(window);
  ceres::Problem problem;
  CeresStep step;
  step.frames.resize(window.keyframes.size());
  step.depths.resize(window.numPoints(), 0.0);
  for (std::size_t k = 0; k < window.keyframes.size(); ++k) {
    step.frames[k].fill(0.0);
    problem.AddParameterBlock(step.frames[k].data(), 8);
    problem.AddResidualBlock(new PriorCost(window.keyframes[k].prior, window.keyframes[k].state),
                             nullptr,
                             step.frames[k].data());
  }
  std::size_t next = 0;
  for (std::size_t host = 0; host < window.keyframes.size(); ++host) {
    for (const WindowPoint& point : window.keyframes[host].points) {
      double* depth = &step.depths[next++];
      bool used = false;
      for (const Observation& o : point) {
        if (o.trial_state != ResidualState::kIn) continue;
        PatchSums sums;
        ResidualGeometry geometry;
        const PairGeometry& pair = pairs.at(host, o.target);
        evaluatePatch(point, pairs.rays(), pair, sums);
        evaluateGeometry(point, pairs.rays(), pair, {}, geometry);
        problem.AddResidualBlock(new PatchCost(sums, geometry, pair),
                                 nullptr,
                                 step.frames[host].data(),
                                 step.frames[o.target].data(),
                                 depth);
        used = true;
      }
      if (!used) continue;
      const auto deviation = static_cast<double>(point.inverse_depth - point.prior_inverse_depth);
      problem.AddResidualBlock(
          new PriorCost(VectorXd::Constant(1, static_cast<double>(point.prior_information)),
                        VectorXd::Constant(1, deviation)),
          nullptr,
          depth);
    }
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.logging_type = ceres::SILENT;
  options.initial_trust_region_radius = 1e16;  // the problem is linear: one undamped step
  options.max_num_iterations = 3;
  options.function_tolerance = 0;
  options.gradient_tolerance = 0;
  options.parameter_tolerance = 0;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem, &summary);
  return step;
}

TEST(NormalEquationsTest, WindowStepEqualsCeres) {
  // Firm depth priors: without them the elimination of depths loses digits of the single-precision
  // rows (measured 7e-7 instead of 2e-7).
  WindowOptions options;
  options.prior.max_depth = 1e7;
  WindowScene scene = perturbedScene(options, 1e-6F);
  const WindowEquations equations = linearized(scene.window);
  const auto [step, depth_step] = stepsOf(scene.window, equations, options, 0);
  const CeresStep ceres_step = solveWithCeres(scene.window);
  VectorXd frames(step.size());
  frames.head<kCameraDim>().setZero();
  for (std::size_t k = 0; k < ceres_step.frames.size(); ++k) {
    frames.segment<8>(kCameraDim + 8 * static_cast<Index>(k)) =
        Eigen::Map<const Vector8d>(ceres_step.frames[k].data());
  }
  const Eigen::Map<const VectorXd> depths(ceres_step.depths.data(), depth_step.size());
  RecordProperty("frames_1e9", std::to_string(1e9 * (frames - step).norm() / step.norm()));
  // Sums of a chunk in single precision: measured 3.1e-6, margin x3; in double precision 2e-7.
  EXPECT_LT((frames - step).norm(), 1e-5 * step.norm());
  EXPECT_LT((depths - depth_step).norm(), 1e-6 * depth_step.norm());
}

TEST(NormalEquationsTest, FrozenResidualsReferToTheFirstEstimates) {
  const WindowOptions options;
  WindowScene scene = perturbedScene(options);
  Random random(5);
  for (Keyframe& keyframe : scene.window.keyframes) {
    for (int i = 0; i < 8; ++i) keyframe.state[i] += 1e-3 * random.gaussian();
  }
  NormalEquationsBuilder builder;
  WindowEquations current, frozen;
  LinearizeOptions linearize;
  const PairTable pairs(scene.window);
  const std::vector<PointRef> points = allPoints(scene.window);
  builder.build(scene.window, pairs, points, linearize, current);
  linearize.frozen = true;
  builder.build(scene.window, pairs, points, linearize, frozen);
  EXPECT_EQ((current.H - frozen.H).norm(), 0);
  const VectorXd expected = frozen.b + frozen.H * scene.window.deviation();
  // Single-precision sums: measured 1e-6, margin x10.
  EXPECT_LT((expected - current.b).norm(), 1e-5 * current.b.norm());
}

TEST(NormalEquationsTest, GaugeDirectionsCostNothing) {
  WindowSceneOptions scene_options;
  scene_options.cell = 20;
  WindowScene scene = makeWindowScene(scene_options, WindowOptions());
  WindowEquations equations = linearized(scene.window);
  WindowElimination elimination;
  elimination.damp(equations, 0);
  elimination.eliminate(equations, equations.H, equations.b);
  const MatrixXd H = equations.H.selfadjointView<Eigen::Lower>();
  const MatrixXd directions = gaugeDirections(scene.window);
  for (Index i = 0; i < directions.cols(); ++i) {
    const double cost = (H * directions.col(i)).norm() / H.norm();
    EXPECT_LT(cost, 1e-6) << "direction " << i;  // single precision
  }
}

TEST(NormalEquationsTest, SameBitsForAnyNumberOfThreads) {
  const WindowOptions options;
  WindowSceneOptions scene_options;
  scene_options.cell = 8;
  WindowScene scene = makeWindowScene(scene_options, options);
  perturb(scene, 1e-3, 9);
  const PairTable pairs(scene.window);
  const std::vector<PointRef> points = allPoints(scene.window);
  ASSERT_GT(points.size(), 1000U);
  const auto build = [&](int threads) {
    WindowEquations equations;
    TaskArena(threads).run([&] {
      NormalEquationsBuilder builder;
      builder.build(scene.window, pairs, points, {}, equations);
    });
    return equations;
  };
  const WindowEquations serial = build(1);
  const WindowEquations parallel = build(2);
  EXPECT_TRUE((serial.H.array() == parallel.H.array()).all());
  EXPECT_TRUE((serial.b.array() == parallel.b.array()).all());
  EXPECT_EQ(serial.coupling, parallel.coupling);
  EXPECT_EQ(serial.depth_hessian, parallel.depth_hessian);
  EXPECT_EQ(serial.depth_gradient, parallel.depth_gradient);
  EXPECT_EQ(serial.energy, parallel.energy);
}

}  // namespace
}  // namespace dsorb::window
