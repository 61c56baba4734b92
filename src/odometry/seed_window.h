// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/image/map_point.h"
#include "dsorb/init/result.h"
#include "dsorb/init/start_judge.h"
#include "dsorb/options/odometry.h"
#include "dsorb/options/window.h"

#include "image/pixel_selector.h"
#include "image/stuck_regions.h"
#include "window/window.h"

#include <cstddef>
#include <vector>

namespace dsorb::odometry {

/// Thins the points of one host to about the wanted number: one in a cell of a grid, the most
/// certain.
/// @return indices of the kept points, ascending
[[nodiscard]] std::vector<std::size_t> thinOnGrid(const std::vector<MapPoint>& points,
                                                  int width,
                                                  int height,
                                                  int wanted);

/// Prior information of a seed: 1 / variance, limited by the options.
[[nodiscard]] float seedInformation(const MapPoint& point, const PriorOptions& options);

/// Makes window points of a keyframe out of seeds; the keyframes added later get residuals to them
/// by addKeyframe, those already there get them here.
/// @return how many; points whose pattern leaves the image are left out
int seedPoints(window::Window& window,
               std::size_t host,
               const std::vector<MapPoint>& points,
               const WindowOptions& options);

/// The first window from any initialization, ready for its first adjustment: reference, hosts,
/// newest frame and, up to WindowOptions::first_keyframes, frames between are keyframes at the
/// given poses and brightness; points are thinned on a grid, the most certain first, with prior
/// information from their variances. Where they are fewer than the
/// window wants, selected pixels of the reference become candidates, are searched in the posed
/// frames and, where there is room, become points as well.
/// @param selector of the keyframes' candidate pixels
/// @note  hosts beyond what the window holds are left out, those with the fewest points first
[[nodiscard]] window::Window seedWindow(const InitializationResult& result,
                                        const PinholeCamera& camera,
                                        const OdometryOptions& options,
                                        PixelSelector& selector);

/// Gives a keyframe of the window its candidates, none where the image moves with the camera.
void selectCandidates(window::Keyframe& keyframe,
                      PixelSelector& selector,
                      const StuckRegions& stuck,
                      int wanted);

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
