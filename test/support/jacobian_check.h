// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include <functional>

namespace dsorb {

/// Central differences of a vector function of n parameters around zero.
/// @param function maps an increment (n) to residuals (m)
/// @return m x n Jacobian
inline Eigen::MatrixXd numericJacobian(
    const std::function<Eigen::VectorXd(const Eigen::VectorXd&)>& function,
    int num_parameters,
    double step = 1e-6) {
  Eigen::VectorXd increment = Eigen::VectorXd::Zero(num_parameters);
  Eigen::MatrixXd J(function(increment).size(), num_parameters);
  for (int i = 0; i < num_parameters; ++i) {
    increment[i] = step;
    const Eigen::VectorXd plus = function(increment);
    increment[i] = -step;
    const Eigen::VectorXd minus = function(increment);
    increment[i] = 0;
    J.col(i) = (plus - minus) / (2 * step);
  }
  return J;
}

/// Largest difference of two Jacobian blocks relative to the larger norm of the two.
inline double relativeDifference(const Eigen::MatrixXd& a, const Eigen::MatrixXd& b) {
  return (a - b).norm() / std::max({a.norm(), b.norm(), 1e-12});
}

}  // namespace dsorb
