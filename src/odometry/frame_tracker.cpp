// SPDX-License-Identifier: BSD-3-Clause
#include "odometry/frame_tracker.h"

#include "window/keyframe_policy.h"

#include <cmath>
#include <utility>

namespace dsorb::odometry {
namespace {

/// Of a keyframe's covariance, which is rather too careful, that frames get by errors of the map.
/// docs/experiments.md, "Covariance of tracked poses"
constexpr double kMapErrorShare = 0.5;

}  // namespace

FrameTracker::FrameTracker(const OdometryOptions& options)
    : options_(options), tracker_(options.tracker, options.brightness) {}

void FrameTracker::begin(const InitializationResult& result) {
  target_.reset();
  history_ = {};
  recent_ = {};
  const SE3 T_ref_newest = result.frames.back().T_cam_ref->inverse();
  for (const PosedFrame& posed : result.frames) {
    if (!posed.T_cam_ref) continue;
    const TimedPose timed{posed.frame->timestamp(), *posed.T_cam_ref * T_ref_newest};
    history_.push(timed);
    recent_.push({timed});
  }
  previous_ = result.frames.back().frame->id();
  rmse_ = track::TrackingStart{}.previous_rmse;
}

void FrameTracker::setTarget(TrackingTarget target) {
  if (target_) {
    history_ = history_.relativeTo(target.T_cam_previous);
    recent_.changeReference(target.T_cam_previous);
  }
  target_ = std::move(target.keyframe);
  tracker_.setReference(std::move(target.reference));
  if (target_->frame->id() == previous_) affine_ = target_->affine;
  first_rmse_.reset();
}

TrackedPose FrameTracker::track(const Frame& frame) {
  const track::TrackingStart start{track::motionGuesses(history_, frame.timestamp()),
                                   affine_,
                                   rmse_,
                                   options_.tracker.max_gain_step,
                                   recent_.poses(),
                                   recent_.sigma()};
  const track::TrackingResult result = tracker_.track(frame, start);
  TrackedPose pose;
  if (std::isfinite(result.rmse[0])) pose.rmse = result.rmse[0];
  if (!result.good()) return pose;
  if (!first_rmse_) first_rmse_ = result.rmse[0];
  pose.good = true;
  pose.keyframe = target_->frame->id();
  pose.T_cam_keyframe = result.T_frame_reference;
  pose.covariance = result.covariance;
  pose.T_cam_world = result.T_frame_reference * target_->T_cam_world;
  addErrorsOfMap(pose);
  pose.affine = affine_ = result.affine;
  pose.wants_keyframe = needsKeyframe(frame, result);
  pose.motion = result.motion;
  const TimedPose timed{frame.timestamp(), result.T_frame_reference};
  recent_.push({timed, result.motion.velocity});
  pose.rows = recent_.atEnd();
  if (recent_.size() > 1) {
    pose.previous = previous_;
    pose.previous_rows = recent_.inMiddle();
  }
  history_.push(timed);
  rmse_ = result.rmse[0];
  previous_ = frame.id();
  return pose;
}

void FrameTracker::addErrorsOfMap(TrackedPose& pose) const {
  if (!pose.covariance || !target_->covariance || !(target_->reach > 0)) return;
  const Matrix6d adjoint = pose.T_cam_keyframe.adjoint();
  const Matrix6d of_keyframe = adjoint * *target_->covariance * adjoint.transpose();
  const double share = pose.T_cam_keyframe.translation().norm() / target_->reach;
  pose.world_covariance = *pose.covariance + (1 + share) * (1 + share) * of_keyframe;
  *pose.covariance += kMapErrorShare * share * share * of_keyframe;
}

bool FrameTracker::needsKeyframe(const Frame& frame, const track::TrackingResult& result) const {
  window::KeyframeCues cues;
  cues.translation_flow = result.flow.translation;
  cues.full_flow = result.flow.full;
  cues.log_gain =
      std::log(brightnessTransfer(
                   target_->affine, target_->frame->exposure(), result.affine, frame.exposure())
                   .gain);
  cues.rmse = result.rmse[0];
  cues.first_rmse = *first_rmse_;
  cues.seconds_since_keyframe = std::abs(frame.timestamp() - target_->frame->timestamp());
  cues.width_plus_height = frame.width() + frame.height();
  return window::needsKeyframe(cues, options_.window);
}

}  // namespace dsorb::odometry
