// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/odometry/observer.h"
#include "dsorb/odometry/odometry.h"

#include "odometry/frame_tracker.h"

#include <optional>

namespace dsorb::odometry {

/// What is told of a frame without a pose.
inline FrameEstimate estimateWithoutPose(const FramePtr& frame,
                                         int segment,
                                         OdometryState state,
                                         std::optional<double> tracking_rmse) {
  FrameEstimate estimate;
  estimate.frame = frame;
  estimate.segment = segment;
  estimate.state = state;
  estimate.tracking_rmse = tracking_rmse;
  return estimate;
}

/// What is told of a tracked frame, in the segment's own unit.
inline FrameEstimate trackedEstimate(const FramePtr& frame, int segment, const TrackedPose& pose) {
  FrameEstimate estimate = estimateWithoutPose(frame, segment, OdometryState::kTracked, pose.rmse);
  estimate.T_world_cam = pose.T_cam_world.inverse();
  estimate.keyframe = pose.keyframe;
  estimate.T_cam_keyframe = pose.T_cam_keyframe;
  estimate.covariance = pose.covariance;
  estimate.world_covariance = pose.world_covariance;
  estimate.affine = pose.affine;
  return estimate;
}

/// What is told of a frame that was recognized, in the unit of the place.
inline FrameEstimate recognizedEstimate(const FramePtr& frame, const RecognizedPlace& place) {
  FrameEstimate estimate =
      estimateWithoutPose(frame, place.segment, OdometryState::kTracked, std::nullopt);
  estimate.T_world_cam = place.T_world_cam;
  estimate.keyframe = place.keyframe;
  estimate.T_cam_keyframe = place.T_cam_keyframe;
  estimate.covariance = place.covariance;
  estimate.world_covariance = place.covariance;
  return estimate;
}

/// What is told of a tracked frame where mapping has made the newest keyframe of it: its pose is
/// that after adjustment.
inline FrameEstimate adjustedEstimate(FrameEstimate estimate, const FrameTracker& tracker) {
  const track::TrackingReference& newest = tracker.reference();
  if (estimate.frame != newest.frame) return estimate;
  estimate.T_world_cam = tracker.target().T_cam_world.inverse();
  estimate.affine = newest.affine;
  if (!estimate.keyframe) {  // of an initialization
    estimate.keyframe = estimate.frame->id();
    estimate.T_cam_keyframe = SE3();
  }
  return estimate;
}

}  // namespace dsorb::odometry
