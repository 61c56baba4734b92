// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

namespace dsorb {

/// Eigenvalues of a symmetric matrix in rising order, eigenvectors as columns.
struct SymmetricEigen {
  Eigen::VectorXd values;
  Eigen::MatrixXd vectors;
};

/// Eigen's solver, compiled here once: every source that names it takes three seconds to compile
/// it. Matrices of fixed size get the same bits as from a solver of that size (3x3 excepted).
/// @param matrix its lower triangle is read
[[nodiscard]] SymmetricEigen symmetricEigen(const Eigen::MatrixXd& matrix);

}  // namespace dsorb
