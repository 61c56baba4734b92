// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/init/start_judge.h"

#include "base/angles.h"
#include "base/median.h"

#include <cmath>
#include <cstddef>

namespace dsorb {
namespace {

constexpr double kChi2Median = 0.4549364231195;  // with one degree of freedom

// Limits of a start that stays. They refuse one of 302 right starts, and 1491 of 1510 that were
// made wrong.
constexpr double kMaxDirection = 8;      // [deg]
constexpr double kMaxDepthSpread = .02;  // below it variances do not matter
constexpr double kMaxDepthChange = 3;
constexpr double kLeastKeptShare = .8;

/// Turn of the camera's place that is farthest from the reference [deg].
double turnOfTheFarthest(const std::vector<StartPose>& poses) {
  double farthest = 0;
  double turn = 0;
  for (const StartPose& pose : poses) {
    const Eigen::Vector3d before = pose.T_cam_ref.inverse().translation();
    if (before.norm() <= farthest) continue;
    farthest = before.norm();
    turn = angleDeg(before, pose.adjusted.inverse().translation());
  }
  return turn;
}

}  // namespace

const char* name(RefusalReason reason) {
  switch (reason) {
    case RefusalReason::kAdjustment:
      return "adjustment";
    case RefusalReason::kDirection:
      return "direction";
    case RefusalReason::kDepth:
      return "depth";
  }
  return "unknown";
}

StartChange startChange(const std::vector<StartPose>& poses,
                        const std::vector<StartPoint>& points) {
  StartChange change;
  change.direction_deg = turnOfTheFarthest(poses);
  std::vector<double> logarithms;
  std::vector<double> variances;
  std::size_t handed_over = 0;
  for (const StartPoint& point : points) {
    if (!(point.inverse_depth > 0)) continue;
    ++handed_over;
    if (!(point.adjusted > 0)) continue;
    logarithms.push_back(std::log(point.adjusted / point.inverse_depth));
    variances.push_back(point.variance / (point.inverse_depth * point.inverse_depth) +
                        point.adjusted_variance / (point.adjusted * point.adjusted));
  }
  if (logarithms.empty()) return change;
  change.kept_share = static_cast<double>(logarithms.size()) / static_cast<double>(handed_over);
  std::vector<double> values = logarithms;
  const double scale = medianInPlace(values);
  std::vector<double> normalized;
  for (std::size_t i = 0; i < values.size(); ++i) {
    const double distance = logarithms[i] - scale;
    values[i] = std::abs(distance);
    normalized.push_back(distance * distance / variances[i]);
  }
  change.depth_spread = kMadToSigma * medianInPlace(values);
  change.depth_change = medianInPlace(normalized) / kChi2Median;
  return change;
}

std::optional<RefusalReason> refusalOf(const StartChange& change) {
  if (!(change.direction_deg <= kMaxDirection)) return RefusalReason::kDirection;
  const bool same_depths =
      change.depth_spread <= kMaxDepthSpread || change.depth_change <= kMaxDepthChange;
  const bool kept = change.kept_share >= kLeastKeptShare;
  return same_depths && kept ? std::nullopt : std::optional(RefusalReason::kDepth);
}

}  // namespace dsorb
