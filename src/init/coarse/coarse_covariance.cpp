// SPDX-License-Identifier: BSD-3-Clause
#include "init/coarse/coarse_covariance.h"

#include "estimate/marginals.h"
#include "image/photometric.h"

#include <algorithm>
#include <cstddef>
#include <numeric>

namespace dsorb::init_coarse {
namespace {

// Effective number of points in the part of an inverse depth's variance that comes from the pose.
// It is larger than for the pose itself, since the depths absorb some errors of the pose.
constexpr double kDepthEffectivePoints = 50;
constexpr float kMinCurvature = 1;  // [grey levels^2 unit^2]; less tells nothing

}  // namespace

std::optional<Uncertainty> uncertaintyOf(const Attempt& attempt,
                                         const TrackedFrame& tracked,
                                         PointLevel& points,
                                         const std::vector<float>& curvature,
                                         LevelAligner& aligner) {
  const LevelState state = aligner.evaluate(
      viewOf(*tracked.frame, attempt.camera, 0), Unknowns::kPose, points, tracked.alignment);
  LinearSystem<float> system = aligner.evaluated();
  std::vector<double> depths(points.x.size(), 0.0);
  std::vector<std::size_t> known;
  for (std::size_t i = 0; i < points.x.size(); ++i) {
    const float elsewhere = curvature.empty() ? 0.0F : curvature[i];
    const float total = points.trial_good[i] != 0 ? points.trial_curvature[i] + elsewhere : 0.0F;
    system.depth_hessian[i] = total < kMinCurvature ? 0.0F : total;
    if (!system.known(i)) continue;
    depths[i] = static_cast<double>(points.trial_inverse_depth[i]);
    known.push_back(i);
  }
  Vector8d scale = Vector8d::Zero();
  scale.head<3>() = tracked.alignment.T_new_ref.translation();
  const Marginals marginals(system, scale, depths);
  if (known.empty() || !marginals.usable()) return std::nullopt;
  const auto count = static_cast<double>(known.size());
  const double depth_sum = std::accumulate(depths.begin(), depths.end(), 0.0);
  const double variance = state.sums.good_energy / (kPatternSize * count);
  const double effective = attempt.options.effective_points;
  const auto inflation = [&](double points_that_tell) {
    return effective > 0 ? std::max(1.0, count / points_that_tell) : 1.0;
  };
  const Eigen::MatrixXd roots = marginals.inGauge(marginals.roots()).topRows<6>();
  const Vector6d of_scale = scale.head<6>();
  Uncertainty result;
  result.pose =
      variance * inflation(effective) *
      (roots * roots.transpose() + marginals.depthVariance() * of_scale * of_scale.transpose());
  Eigen::MatrixXd effects(scale.size(), static_cast<Eigen::Index>(known.size()));
  for (Eigen::Index k = 0; k < effects.cols(); ++k) {
    const std::size_t i = known[static_cast<std::size_t>(k)];
    marginals.depthEffect(system, i, depths[i], effects.col(k));
  }
  const Eigen::VectorXd from_pose =
      marginals.solve(effects).cwiseProduct(effects).colwise().sum().transpose();
  result.inverse_depth.assign(points.x.size(), 0.0);
  for (Eigen::Index k = 0; k < effects.cols(); ++k) {
    const std::size_t i = known[static_cast<std::size_t>(k)];
    const double own = std::max(0.0, 1 - 2 * depths[i] / depth_sum) /
                           static_cast<double>(system.depth_hessian[i]) +
                       depths[i] * depths[i] * marginals.depthVariance();
    result.inverse_depth[i] = variance * (own + inflation(kDepthEffectivePoints) * from_pose[k]);
  }
  return result;
}

}  // namespace dsorb::init_coarse
