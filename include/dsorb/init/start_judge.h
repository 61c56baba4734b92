// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/geometry/se3.h"

#include <optional>
#include <vector>

namespace dsorb {

/// What the first adjustment of the window made of an initialization, the reference being at rest.
struct StartChange {
  /// Turn of the translation from the reference to the keyframe farthest from it [deg].
  double direction_deg = 0;
  /// Standard deviation of the logarithm of adjusted over initial inverse depths [-], robust; their
  /// median, a change of scale, is taken out.
  double depth_spread = 0;
  /// Median of the square of that logarithm over its variance, in units of the median of chi^2 with
  /// one degree of freedom. The variance is the one handed over and the window's own together, the
  /// latter with the noise of a right map at most.
  double depth_change = 0;
  double kept_share = 0;  ///< share of the points handed over that the window keeps
};

/// Reason why the window refused a start.
enum class RefusalReason {
  kAdjustment,  ///< its first adjustment broke down or used no residual
  kDirection,   ///< the direction of motion turned
  kDepth  ///< the depths became others, by more than their variances allow, or points were lost
};

/// Name as in initialization.json, for example "depth".
[[nodiscard]] const char* name(RefusalReason reason);

/// A keyframe of a start, without the reference, before and after the first adjustment.
struct StartPose {
  SE3 T_cam_ref;  ///< pose as handed over
  SE3 adjusted;   ///< T_cam_ref of the adjusted poses, in any unit
};

/// A point of a start before and after the first adjustment.
struct StartPoint {
  double inverse_depth = 0;  ///< as handed over [1/unit]; a point where it is not positive is left
                             ///< out
  double variance = 0;       ///< variance as handed over [1/unit^2]
  double adjusted = 0;       ///< inverse depth [1/unit]; 0: the adjustment has dropped the point
  /// Variance of the adjusted inverse depth [1/unit^2], poses taken as exact: noise^2 over the
  /// curvature of the point's residuals, with the noise limited to kMaxStartNoise.
  double adjusted_variance = 0;
};

/// Largest standard deviation of a pixel's residual that a right map leaves [grey levels]. A wrong
/// map leaves more, and with it everything would seem unsure and nothing contradicted.
constexpr double kMaxStartNoise = 7;

/// What an adjustment made of a start, whoever made it: a window of keyframes with photometric
/// residuals in which the points have at least two observations.
/// @param poses  keyframes of the start but the reference; at least one
/// @param points handed over to the adjustment, those that it dropped included, but not those that
///               it dropped because they leave the image
/// @return kept_share and what is said of depths are 0 where no point is left
[[nodiscard]] StartChange startChange(const std::vector<StartPose>& poses,
                                      const std::vector<StartPoint>& points);

/// Judges a start by its first adjustment. Odometry does so for at most
/// OdometryOptions::max_refusals starts in a row: then the scene is one where the limits err.
/// @return why it is refused; nothing: it stays
[[nodiscard]] std::optional<RefusalReason> refusalOf(const StartChange& change);

}  // namespace dsorb
