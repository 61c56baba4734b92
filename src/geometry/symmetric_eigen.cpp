// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/symmetric_eigen.h"

#include <Eigen/Eigenvalues>

namespace dsorb {

SymmetricEigen symmetricEigen(const Eigen::MatrixXd& matrix) {
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(matrix);
  return {solver.eigenvalues(), solver.eigenvectors()};
}

}  // namespace dsorb
