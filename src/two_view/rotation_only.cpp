// SPDX-License-Identifier: BSD-3-Clause
#include "two_view/rotation_only.h"

#include "base/angles.h"
#include "base/median.h"

#include <Eigen/SVD>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <utility>

namespace dsorb {
namespace {

constexpr int kRounds = 10;        // the angle then changes by less than a hundredth of a pixel
constexpr double kMinChord = 0.1;  // [px]; smaller residuals are noise of the tracks
constexpr double kBehindResidual =
    1e6;  // [px]; a bearing that the rotation turns behind the camera

Eigen::Quaterniond alignBearings(const std::vector<Eigen::Vector3d>& from,
                                 const std::vector<Eigen::Vector3d>& to,
                                 const std::vector<double>& weights) {
  Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
  for (std::size_t i = 0; i < from.size(); ++i) {
    sum += weights[i] * to[i] * from[i].transpose();
  }
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(sum, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Eigen::Matrix3d& U = svd.matrixU();
  const Eigen::Matrix3d& V = svd.matrixV();
  const double handedness = (U * V.transpose()).determinant() < 0 ? -1.0 : 1.0;
  const Eigen::Matrix3d R = U * Eigen::Vector3d(1, 1, handedness).asDiagonal() * V.transpose();
  return Eigen::Quaterniond(R).normalized();
}

}  // namespace

RotationFit fitRotation(const Matches& matches, const PinholeCamera& camera) {
  assert(matches.size() > 0);
  const std::size_t n = matches.size();
  std::vector<Eigen::Vector3d> from(n);
  std::vector<Eigen::Vector3d> to(n);
  for (std::size_t i = 0; i < n; ++i) {
    from[i] = camera.unproject(matches.reference[i]).normalized();
    to[i] = camera.unproject(matches.target[i]).normalized();
  }
  const double min_chord = kMinChord / camera.fx;
  std::vector<double> weights(n, 1.0);
  RotationFit fit;
  for (int round = 0; round < kRounds; ++round) {
    fit.R_cur_ref = alignBearings(from, to, weights);
    for (std::size_t i = 0; i < n; ++i) {
      weights[i] = 1.0 / std::max((fit.R_cur_ref * from[i] - to[i]).norm(), min_chord);
    }
  }
  std::vector<double> residuals(n);
  for (std::size_t i = 0; i < n; ++i) {
    const Eigen::Vector3d turned = fit.R_cur_ref * from[i];
    residuals[i] =
        turned.z() > 0 ? (camera.project(turned) - matches.target[i]).norm() : kBehindResidual;
  }
  fit.median_residual = medianOf(std::move(residuals));
  return fit;
}

double rotationResidualDeg(const Matches& matches, const PinholeCamera& camera) {
  return std::atan(fitRotation(matches, camera).median_residual / camera.fx) * kDegPerRad;
}

}  // namespace dsorb
