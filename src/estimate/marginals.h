// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "estimate/linear_system.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>

#include <algorithm>
#include <cstddef>
#include <vector>

namespace dsorb {

/// Marginal covariances of the frames' states whose inverse depths are eliminated from a system, in
/// the gauge "reference pose and mean inverse depth fixed", for errors of unit variance.
///
/// With A_i = c_i / h_i (c_i: coupling of point i, h_i: its curvature), S the Schur complement over
/// the inverse depths, n the direction in which all translations grow together (it leaves every
/// residual unchanged while the inverse depths rho shrink) and m = sum A_i / sum rho_i:
///   states           P S^- P^T + n n^T v,  P = I - n m^T,  v = sum(1 / h_i) / (sum rho_i)^2
///   inverse depth i  1 / h_i (1 - 2 rho_i / sum rho) + rho_i^2 v + g_i^T S^- g_i,
///                    g_i = A_i - rho_i m
/// for any generalised inverse S^-, because P n = 0 and g_i^T n = 0.
/// @source derived from Triggs et al., Bundle Adjustment - A Modern Synthesis, section 9 (gauge
///         projection); compared with dense and sparse QR solutions in geometric_covariance_test
class Marginals {
 public:
  Marginals() = default;
  /// @param scale         n; zeros for states that are no translations, all zeros where the system
  ///                      knows the scale: there is no gauge to be fixed then
  /// @param inverse_depth rho, of all points; filled up with zeros where the system's are
  Marginals(const LinearSystem<double>& system,
            const Eigen::VectorXd& scale,
            const std::vector<double>& inverse_depth);

  /// Whether the system determines its solution; nothing else may be asked when not.
  [[nodiscard]] bool usable() const { return usable_; }
  /// S^- times columns.
  [[nodiscard]] Eigen::MatrixXd solve(const Eigen::MatrixXd& columns) const {
    return cholesky_.solve(columns);
  }
  /// Columns r with sum of r r^T = S^-.
  [[nodiscard]] Eigen::MatrixXd roots() const;
  /// P times columns: the gauge of their rows.
  [[nodiscard]] Eigen::MatrixXd inGauge(const Eigen::MatrixXd& columns) const;
  /// S^- (sum of q q^T) S^-, q the gradients that independent clusters of errors leave of the
  /// states: the sandwich estimate of the covariance, before the gauge, as its roots.
  /// @param gradients one column a cluster
  /// @param frames    as many as moved: each takes one cluster's worth of freedom
  /// @source White, A Heteroskedasticity-Consistent Covariance Matrix Estimator, Econometrica 1980,
  ///         with clusters
  [[nodiscard]] Eigen::MatrixXd clusteredRoots(const Eigen::MatrixXd& gradients,
                                               Eigen::Index frames) const;
  /// g_i: how much an inverse depth falls by a unit of every state, in the gauge.
  void depthEffect(const LinearSystem<double>& system,
                   std::size_t point,
                   double inverse_depth,
                   Eigen::Ref<Eigen::VectorXd> effect) const;
  /// What an inverse depth has in its variance beside g_i^T S^- g_i; at least rho_i^2 v.
  [[nodiscard]] double ownVariance(const LinearSystem<double>& system,
                                   std::size_t point,
                                   double inverse_depth) const {
    const double own =
        std::max(0.0, 1 - 2 * inverse_depth / depth_sum_) / system.depth_hessian[point];
    return own + inverse_depth * inverse_depth * depth_variance_;
  }
  /// v: variance of the mean inverse depth, poses known, over its square.
  [[nodiscard]] double depthVariance() const { return depth_variance_; }

 private:
  Eigen::VectorXd scale_;
  Eigen::VectorXd ratio_;
  double depth_sum_ = 0;
  double depth_variance_ = 0;
  Eigen::LLT<Eigen::MatrixXd> cholesky_;
  bool usable_ = false;
};

}  // namespace dsorb
