// SPDX-License-Identifier: BSD-3-Clause
#include "place/alignment.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include <algorithm>
#include <cmath>

namespace dsorb::place {
namespace {

constexpr std::size_t kMinSights = 8;
constexpr int kMaxSteps = 25;
constexpr double kSmallStep = 1e-7;
constexpr double kFits = 9.2;  // chi-square, 2 degrees of freedom, 99 %

using Matrix27 = Eigen::Matrix<double, 2, 7>;
using Square7 = Eigen::Matrix<double, 7, 7>;
using Column7 = Eigen::Matrix<double, 7, 1>;

/// A sight's error over its standard deviation, squared, and what it adds to the equations.
struct Term {
  double squared = INFINITY;
  Eigen::Vector2d residual;
  Eigen::Matrix2d information;
  Matrix27 J;
};

Term termOf(const Sight& sight, const Similarity& S_a_b, const Similarity& S_b_a) {
  const Similarity& S = sight.backward ? S_b_a : S_a_b;
  const Eigen::Vector3d in_other = S * sight.point;
  const Eigen::Vector3d p = sight.T_cam_map * in_other;
  Term term;
  if (!(p.z() > 0)) return term;
  Eigen::Matrix<double, 2, 3> projection;
  projection << sight.camera.fx / p.z(), 0, -sight.camera.fx * p.x() / (p.z() * p.z()), 0,
      sight.camera.fy / p.z(), -sight.camera.fy * p.y() / (p.z() * p.z());
  projection = projection * sight.T_cam_map.rotationMatrix();
  Eigen::Matrix<double, 3, 7> moved;  // the point in map a by the increment
  const Eigen::Vector3d& in_a = sight.backward ? sight.point : in_other;
  moved << Eigen::Matrix3d::Identity(), -hat(in_a), in_a;
  const Eigen::Matrix3d linear = S.scale * S.motion.rotationMatrix();
  if (sight.backward) moved = -linear * moved;
  term.J = projection * moved;
  term.residual = sight.camera.project(p) - sight.pixel;
  const Eigen::Vector2d by_depth = projection * (linear * sight.uncertainty);
  const Eigen::Matrix2d covariance =
      sight.sigma * sight.sigma * Eigen::Matrix2d::Identity() + by_depth * by_depth.transpose();
  term.information = covariance.inverse();
  term.squared = term.residual.dot(term.information * term.residual);
  return term;
}

struct Equations {
  Square7 hessian = Square7::Zero();
  Column7 gradient = Column7::Zero();
};

Equations equationsOf(const std::vector<Sight>& sights, const Similarity& S, bool free_scale) {
  Equations sum;
  const Similarity back = S.inverse();
  for (const Sight& sight : sights) {
    const Term term = termOf(sight, S, back);
    if (!std::isfinite(term.squared)) continue;
    const double weight = 1 / (1 + term.squared / kFits);
    const Eigen::Matrix<double, 7, 2> weighted = weight * term.J.transpose() * term.information;
    sum.hessian += weighted * term.J;
    sum.gradient += weighted * term.residual;
  }
  if (!free_scale) {
    sum.hessian.row(6).setZero();
    sum.hessian.col(6).setZero();
    sum.gradient[6] = 0;
    sum.hessian(6, 6) = 1;
  }
  return sum;
}

}  // namespace

std::optional<Alignment> align(const std::vector<Sight>& sights,
                               const Similarity& guess,
                               bool free_scale) {
  if (sights.size() < kMinSights) return std::nullopt;
  Alignment result;
  result.S_a_b = guess;
  for (int step = 0; step < kMaxSteps; ++step) {
    const Equations sum = equationsOf(sights, result.S_a_b, free_scale);
    const Column7 xi = -sum.hessian.ldlt().solve(sum.gradient);
    if (!xi.allFinite() || xi.norm() > 1e3) return std::nullopt;
    result.S_a_b = Similarity::increment(xi) * result.S_a_b;
    if (xi.norm() < kSmallStep) break;
  }
  const Equations sum = equationsOf(sights, result.S_a_b, free_scale);
  const Similarity back = result.S_a_b.inverse();
  for (const Sight& sight : sights) {
    const double squared = termOf(sight, result.S_a_b, back).squared;
    result.fits.push_back(squared < kFits ? 1 : 0);
    if (squared < kFits) result.mean_square += squared / 2;
  }
  result.inliers = static_cast<std::size_t>(std::count(result.fits.begin(), result.fits.end(), 1));
  if (result.inliers < kMinSights) return std::nullopt;
  result.mean_square /= static_cast<double>(result.inliers);
  const Square7 covariance = sum.hessian.inverse() * std::max(1.0, result.mean_square);
  if (!covariance.allFinite() || !(covariance.diagonal().minCoeff() > 0)) return std::nullopt;
  result.covariance = covariance;
  if (!free_scale) result.covariance(6, 6) = 0;
  return result;
}

}  // namespace dsorb::place
