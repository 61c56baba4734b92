// SPDX-License-Identifier: BSD-3-Clause
#include "init/coarse/coarse_covariance.h"

#include "image/photometric.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cstddef>

namespace dsorb::init_coarse {
namespace {

constexpr int kParameters = 8;
// Effective number of points in the part of an inverse depth's variance that comes from the pose.
// It is larger than for the pose itself, since the depths absorb some errors of the pose.
constexpr double kDepthEffectivePoints = 50;
constexpr double kMinCurvature = 1;  // [grey levels^2 unit^2]; less tells nothing

/// Equations of the pose, brightness and inverse depths eliminated, with what undoes the latter.
struct PoseSystem {
  Matrix6d information = Matrix6d::Zero();
  std::vector<Vector6d> coupling;  ///< over the curvature, a point
  std::vector<double> own;         ///< inverse curvature, a point; 0: not good
  Vector6d mean_coupling = Vector6d::Zero();
  double mean_depth = 0;     ///< mean inverse depth [1/unit]
  double mean_variance = 0;  ///< of the mean inverse depth, pose known
  int good = 0;
};

PoseSystem eliminate(const NormalEquations& equations,
                     const SchurTerms& schur,
                     const PointLevel& points,
                     const std::vector<float>& curvature) {
  PoseSystem system;
  system.own.assign(points.x.size(), 0.0);
  system.coupling.assign(points.x.size(), Vector6d::Zero());
  Matrix8d reduced = equations.H;
  for (std::size_t i = 0; i < points.x.size(); ++i) {
    if (points.trial_good[i] == 0) continue;
    const float elsewhere = curvature.empty() ? 0.0F : curvature[i];
    const auto known = static_cast<double>(points.trial_curvature[i] + elsewhere);
    if (known < kMinCurvature) continue;
    const Vector8d h =
        Eigen::Map<const Eigen::Matrix<float, kParameters, 1>>(&schur.coupling[i * kParameters])
            .cast<double>();
    reduced -= h * h.transpose() / known;
    system.own[i] = 1.0 / known;
    system.coupling[i] = h.head<6>() / known;
    system.mean_coupling += system.coupling[i];
    system.mean_variance += system.own[i];
    system.mean_depth += static_cast<double>(points.trial_inverse_depth[i]);
    ++system.good;
  }
  const double n = std::max(system.good, 1);
  system.mean_depth /= n;
  system.mean_coupling /= n;
  system.mean_variance /= n * n;
  const Eigen::Matrix<double, 6, 2> brightness = reduced.topRightCorner<6, 2>();
  system.information =
      reduced.topLeftCorner<6, 6>() -
      brightness * reduced.bottomRightCorner<2, 2>().ldlt().solve(brightness.transpose());
  return system;
}

}  // namespace

std::optional<Uncertainty> uncertaintyOf(const Attempt& attempt,
                                         const TrackedFrame& tracked,
                                         PointLevel& points,
                                         const std::vector<float>& curvature,
                                         LevelAligner& aligner) {
  const LevelState state = aligner.evaluate(
      viewOf(*tracked.frame, attempt.camera, 0), Unknowns::kPose, points, tracked.alignment);
  const PoseSystem system = eliminate(state.equations, aligner.evaluated(), points, curvature);
  // Scale is unobservable: its direction gets the mean curvature of the others.
  Vector6d scale = Vector6d::Zero();
  scale.head<3>() = tracked.alignment.T_new_ref.translation();
  const Vector6d unit_scale = scale.normalized();
  const Eigen::LLT<Matrix6d> cholesky(system.information + system.information.trace() / 6 *
                                                               unit_scale * unit_scale.transpose());
  if (system.good == 0 || !(system.mean_depth > 0) || cholesky.info() != Eigen::Success)
    return std::nullopt;
  const double residual_variance =
      state.equations.good_energy / (static_cast<double>(kPatternSize) * system.good);
  const double effective = attempt.options.effective_points;
  const double inflation = effective > 0 ? std::max(1.0, system.good / effective) : 1.0;
  const double depth_inflation =
      effective > 0 ? std::max(1.0, system.good / kDepthEffectivePoints) : 1.0;
  // Gauge: a relative change of the mean inverse depth is one of the translation's length.
  const Vector6d mean_coupling = system.mean_coupling / system.mean_depth;
  const double mean_variance = system.mean_variance / (system.mean_depth * system.mean_depth);
  const Matrix6d projector = Matrix6d::Identity() - scale * mean_coupling.transpose();
  const Matrix6d root = cholesky.matrixL().solve(projector.transpose());
  Uncertainty result;
  result.pose = inflation * residual_variance *
                (root.transpose() * root + mean_variance * scale * scale.transpose());
  result.inverse_depth.assign(points.x.size(), 0.0);
  for (std::size_t i = 0; i < points.x.size(); ++i) {
    if (!(system.own[i] > 0)) continue;
    const double depth = static_cast<double>(points.trial_inverse_depth[i]) / system.mean_depth;
    const double from_pose =
        cholesky.matrixL().solve(system.coupling[i] - depth * system.mean_coupling).squaredNorm();
    const double own = system.own[i] * std::max(0.0, 1.0 - 2.0 * depth / system.good) +
                       depth * depth * system.mean_variance;
    result.inverse_depth[i] = residual_variance * (own + depth_inflation * from_pose);
  }
  return result;
}

}  // namespace dsorb::init_coarse
