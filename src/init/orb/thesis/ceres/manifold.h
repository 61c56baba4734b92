// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <ceres/problem.h>
#include <ceres/version.h>

#if CERES_VERSION_MAJOR > 2 || CERES_VERSION_MINOR > 0
#include <ceres/manifold.h>
#else
#include <ceres/local_parameterization.h>
#endif

/// Manifolds of Ceres 2.1 and newer, and of Ceres 2.0, which calls them local parameterizations.
namespace dsorb::init_orb {

#if CERES_VERSION_MAJOR > 2 || CERES_VERSION_MINOR > 0
using CeresManifold = ceres::Manifold;

inline void setManifold(ceres::Problem& problem, double* block, CeresManifold& manifold) {
  problem.SetManifold(block, &manifold);
}
/// Their caller owns them.
inline void borrowManifolds(ceres::Problem::Options& options) {
  options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
}
#else
class CeresManifold : public ceres::LocalParameterization {
 public:
  [[nodiscard]] virtual int AmbientSize() const = 0;
  [[nodiscard]] virtual int TangentSize() const = 0;
  virtual bool PlusJacobian(const double* x, double* jacobian) const = 0;
  virtual bool Minus(const double* y, const double* x, double* y_minus_x) const = 0;
  virtual bool MinusJacobian(const double* x, double* jacobian) const = 0;

  [[nodiscard]] int GlobalSize() const final { return AmbientSize(); }
  [[nodiscard]] int LocalSize() const final { return TangentSize(); }
  bool ComputeJacobian(const double* x, double* jacobian) const final {
    return PlusJacobian(x, jacobian);
  }
};

inline void setManifold(ceres::Problem& problem, double* block, CeresManifold& manifold) {
  problem.SetParameterization(block, &manifold);
}
inline void borrowManifolds(ceres::Problem::Options& options) {
  options.local_parameterization_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
}
#endif

}  // namespace dsorb::init_orb
