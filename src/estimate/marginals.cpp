// SPDX-License-Identifier: BSD-3-Clause
#include "estimate/marginals.h"

#include <cmath>
#include <limits>

namespace dsorb {

Marginals::Marginals(const LinearSystem<double>& system,
                     const Eigen::VectorXd& scale,
                     const std::vector<double>& inverse_depth)
    : scale_(scale), ratio_(Eigen::VectorXd::Zero(system.size())) {
  double variance_sum = 0;
  for (std::size_t i = 0; i < inverse_depth.size(); ++i) {
    depth_sum_ += inverse_depth[i];
    if (!system.known(i)) continue;
    const double variance = 1 / system.depth_hessian[i];
    ratio_ += variance * system.couplingOf(i);
    variance_sum += variance;
  }
  ratio_ /= depth_sum_;
  depth_variance_ = variance_sum / (depth_sum_ * depth_sum_);
  if (scale_.isZero(0)) {
    ratio_.setZero();
    depth_variance_ = 0;
    depth_sum_ = std::numeric_limits<double>::infinity();
  }
  Eigen::MatrixXd reduced = system.H;
  Eigen::VectorXd right = system.b;
  DepthElimination<double> elimination;
  elimination.damp(system, 0);
  elimination.eliminate(system, reduced, right);
  if (reduced.size() == 0) return;
  // Scale is unobservable: its direction gets the mean curvature of the others, which the gauge
  // projection removes again.
  const Eigen::VectorXd unit_scale = scale_.normalized();
  const double curvature = reduced.trace() / static_cast<double>(reduced.rows());
  cholesky_.compute(reduced + curvature * unit_scale * unit_scale.transpose());
  usable_ = cholesky_.info() == Eigen::Success;
}

Eigen::MatrixXd Marginals::roots() const {
  return cholesky_.matrixU().solve(Eigen::MatrixXd::Identity(scale_.size(), scale_.size()));
}

Eigen::MatrixXd Marginals::inGauge(const Eigen::MatrixXd& columns) const {
  return columns - scale_ * (ratio_.transpose() * columns);
}

Eigen::MatrixXd Marginals::clusteredRoots(const Eigen::MatrixXd& gradients,
                                          Eigen::Index frames) const {
  const auto clusters = static_cast<double>(gradients.cols());
  const double free = std::max(clusters - static_cast<double>(frames), 1.0);
  return std::sqrt(clusters / free) * cholesky_.solve(gradients);
}

void Marginals::depthEffect(const LinearSystem<double>& system,
                            std::size_t point,
                            double inverse_depth,
                            Eigen::Ref<Eigen::VectorXd> effect) const {
  effect = system.couplingOf(point) / system.depth_hessian[point] - inverse_depth * ratio_;
}

}  // namespace dsorb
