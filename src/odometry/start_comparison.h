// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/result.h"
#include "dsorb/init/start_judge.h"

#include "window/window.h"

#include <vector>

namespace dsorb::odometry {

/// An initialization beside the window that was seeded with it: the window sees more pixels of the
/// same frames and owes the initializer nothing but its priors. Where its estimate leaves the
/// initialization by more than both are sure of, the start is wrong.
class StartComparison {
 public:
  /// @param seeded by the result, not yet adjusted
  StartComparison(const InitializationResult& result, const window::Window& seeded);

  /// @param adjusted the same window after its first adjustment, unused points taken out
  /// @param noise    standard deviation of a pixel's residual after it [grey levels]
  [[nodiscard]] StartChange change(const window::Window& adjusted, double noise) const;

 private:
  struct Point {
    window::PointId id;
    double inverse_depth = 0;  ///< handed over [1/unit]
    double variance = 0;       ///< handed over [1/unit^2]
    bool stays = false;        ///< the newest keyframe sees it, too
  };
  std::vector<Point> points_;  // in the order of their ids
  std::vector<SE3> T_cam_world_;
};

}  // namespace dsorb::odometry
