// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/result.h"
#include "dsorb/odometry/observer.h"

#include <optional>
#include <vector>

namespace dsorb::odometry {

/// Unit in which a segment is told: metres where its start has a metric scale, else the start's
/// own. Inside the odometry it is always the start's own, so that a wrong scale moves nothing.
class SegmentUnit {
 public:
  SegmentUnit() = default;
  explicit SegmentUnit(const std::optional<MetricScale>& metric) {
    if (metric) metres_ = metric->metres;
  }

  [[nodiscard]] FrameEstimate told(FrameEstimate estimate) const {
    if (metres_ == 1) return estimate;
    if (estimate.T_world_cam) scale(*estimate.T_world_cam);
    if (estimate.T_cam_keyframe) scale(*estimate.T_cam_keyframe);
    for (auto* covariance : {&estimate.covariance, &estimate.world_covariance}) {
      if (!*covariance) continue;
      (*covariance)->topRows<3>() *= metres_;
      (*covariance)->leftCols<3>() *= metres_;
    }
    return estimate;
  }
  [[nodiscard]] std::vector<KeyframeSnapshot> told(std::vector<KeyframeSnapshot> keyframes) const {
    if (metres_ == 1) return keyframes;
    const auto metres = static_cast<float>(metres_);
    for (KeyframeSnapshot& keyframe : keyframes) {
      scale(keyframe.T_world_cam);
      for (MapPoint& point : keyframe.points) {
        point.inverse_depth /= metres;
        point.variance /= metres * metres;
      }
    }
    return keyframes;
  }

 private:
  void scale(SE3& pose) const { pose.setTranslation(metres_ * pose.translation()); }

  double metres_ = 1;
};

}  // namespace dsorb::odometry
