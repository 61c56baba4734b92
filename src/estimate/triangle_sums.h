// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "base/lanes.h"

#include <Eigen/Core>

#include <cstddef>

/// Normal equations of a few unknowns as one array: the upper triangle of sum w J J^T row by row,
/// each row followed by the entry of sum w J r.
namespace dsorb {

/// Length of the array. @param size number of unknowns
constexpr std::size_t triangleSums(std::size_t size) {
  return size * (size + 3) / 2;
}

/// Adds one residual, or one a lane.
/// @param J kSize of them
template <int kSize, typename T>
DSORB_ALWAYS_INLINE void addToTriangle(const T* J, const T& weight, const T& residual, T* sums) {
  int entry = 0;
  for (int i = 0; i < kSize; ++i) {
    const T weighted = weight * J[i];
    for (int j = i; j < kSize; ++j) sums[entry++] += weighted * J[j];
    sums[entry++] += weighted * residual;
  }
}

/// Adds an array to the block of a system that begins with row `first`.
/// @param H upper triangle
template <typename Scalar, typename Matrix, typename Vector>
void addTriangle(const Scalar* sums, Eigen::Index first, Eigen::Index size, Matrix& H, Vector& b) {
  for (Eigen::Index i = first; i < first + size; ++i) {
    for (Eigen::Index j = i; j < first + size; ++j) H(i, j) += static_cast<double>(*sums++);
    b[i] += static_cast<double>(*sums++);
  }
}

}  // namespace dsorb
