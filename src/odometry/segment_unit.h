// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/result.h"
#include "dsorb/odometry/observer.h"

#include <optional>
#include <vector>

namespace dsorb::odometry {

/// Unit in which a segment is told: metres where its start has a metric scale, else the start's
/// own. Inside the odometry it is always the start's own, so that a wrong scale moves nothing.
/// After a place was recognized it is the unit, and the world, of the segment of before.
class SegmentUnit {
 public:
  SegmentUnit() = default;
  explicit SegmentUnit(const std::optional<MetricScale>& metric) {
    if (metric) metres_ = metric->metres;
  }
  /// @param T_world_start pose of the start's reference in the world of `segment`
  SegmentUnit(const std::optional<MetricScale>& metric, int segment, const SE3& T_world_start)
      : SegmentUnit(metric) {
    segment_ = segment;
    T_world_start_ = T_world_start;
  }

  [[nodiscard]] FrameEstimate told(FrameEstimate estimate) const {
    if (isOwn()) return estimate;
    estimate.segment = segment_.value_or(estimate.segment);
    if (estimate.T_world_cam) place(*estimate.T_world_cam);
    if (estimate.T_cam_keyframe) scale(*estimate.T_cam_keyframe);
    for (auto* covariance : {&estimate.covariance, &estimate.world_covariance}) {
      if (!*covariance) continue;
      (*covariance)->topRows<3>() *= metres_;
      (*covariance)->leftCols<3>() *= metres_;
    }
    return estimate;
  }
  [[nodiscard]] std::vector<KeyframeSnapshot> told(std::vector<KeyframeSnapshot> keyframes) const {
    if (isOwn()) return keyframes;
    const auto metres = static_cast<float>(metres_);
    for (KeyframeSnapshot& keyframe : keyframes) {
      keyframe.segment = segment_.value_or(keyframe.segment);
      place(keyframe.T_world_cam);
      for (MapPoint& point : keyframe.points) {
        point.inverse_depth /= metres;
        point.variance /= metres * metres;
      }
    }
    return keyframes;
  }

  /// The number that a segment is told by.
  [[nodiscard]] int told(int segment) const { return segment_.value_or(segment); }

 private:
  [[nodiscard]] bool isOwn() const { return metres_ == 1 && !segment_; }
  void place(SE3& pose) const {
    scale(pose);
    if (T_world_start_) pose = *T_world_start_ * pose;
  }
  void scale(SE3& pose) const { pose.setTranslation(metres_ * pose.translation()); }

  double metres_ = 1;
  std::optional<int> segment_;
  std::optional<SE3> T_world_start_;
};

}  // namespace dsorb::odometry
