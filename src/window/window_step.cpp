// SPDX-License-Identifier: BSD-3-Clause
#include "window/window_step.h"

#include "geometry/symmetric_eigen.h"

#include <cmath>

namespace dsorb::window {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kSingularCutOff = 1e-5;  // relative, of gauge directions

}  // namespace

StatePrior statePrior(const Window& window, const WindowOptions& options) {
  StatePrior prior{VectorXd::Zero(window.dimension()), VectorXd::Zero(window.dimension()), 0};
  VectorXd value(window.dimension());
  value.head<kCameraDim>() = window.camera_state;
  if (options.optimizer.optimize_intrinsics) {
    prior.information.head<kCameraDim>().setConstant(options.prior.intrinsics);
  }
  Index at = kCameraDim;
  for (const Keyframe& keyframe : window.keyframes) {
    prior.information.segment<kFrameDim>(at) = keyframe.prior;
    value.segment<kFrameDim>(at) = keyframe.state;
    at += kFrameDim;
  }
  prior.gradient = prior.information.cwiseProduct(value);
  prior.energy = prior.gradient.dot(value);
  return prior;
}

MatrixXd gaugeDirections(const Window& window) {
  MatrixXd directions = MatrixXd::Zero(window.dimension(), 7);
  const Eigen::Matrix<double, 6, 1> to_scaled = frameScale().head<6>().cwiseInverse();
  Index at = kCameraDim;
  for (const Keyframe& keyframe : window.keyframes) {
    const SE3& T = keyframe.T_cam_world_first;
    directions.block<6, 6>(at, 0) = to_scaled.asDiagonal() * T.adjoint();
    directions.block<3, 1>(at, 6) = to_scaled.head<3>().cwiseProduct(T.translation());
    at += kFrameDim;
  }
  for (Index i = 0; i < directions.cols(); ++i) {
    const double norm = directions.col(i).norm();
    if (norm > 0) directions.col(i) /= norm;
  }
  return directions;
}

VectorXd withoutGauge(const VectorXd& step, const MatrixXd& directions) {
  const Eigen::Matrix<double, 7, 7> gram = directions.transpose() * directions;
  const SymmetricEigen eigen = symmetricEigen(gram);
  const double cut_off = kSingularCutOff * kSingularCutOff * eigen.values[6];
  VectorXd result = step;
  for (Index i = 0; i < 7; ++i) {
    const double eigenvalue = eigen.values[i];
    if (!(eigenvalue > cut_off)) continue;
    const VectorXd direction = directions * eigen.vectors.col(i) / std::sqrt(eigenvalue);
    result -= direction * direction.dot(step);
  }
  return result;
}

VectorXd solveStep(const Window& window,
                   const WindowEquations& equations,
                   const WindowOptions& options,
                   double damping,
                   WindowElimination& elimination) {
  const StatePrior prior = statePrior(window, options);
  MatrixXd H = equations.H + window.prior.H;
  H.diagonal() += prior.information;
  H.diagonal() *= 1 + damping;
  VectorXd b = equations.b + prior.gradient + window.prior.b + window.prior.H * window.deviation();
  elimination.damp(equations, damping);
  elimination.eliminate(equations, H, b);
  if (!options.optimizer.optimize_intrinsics) {
    H.topRows<kCameraDim>().setZero();
    H.leftCols<kCameraDim>().setZero();
    H.topLeftCorner<kCameraDim, kCameraDim>().setIdentity();
    b.head<kCameraDim>().setZero();
  }
  return -solvePreconditioned(H, b);
}

}  // namespace dsorb::window
