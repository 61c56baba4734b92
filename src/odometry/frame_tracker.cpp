// SPDX-License-Identifier: BSD-3-Clause
#include "odometry/frame_tracker.h"

#include "base/angles.h"
#include "estimate/variance_factors.h"
#include "features/grey_image.h"
#include "window/keyframe_policy.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <utility>

namespace dsorb::odometry {
namespace {

std::vector<DepthSample> samplesOf(const track::TrackingReference& reference) {
  const track::ReferencePoints& points = reference.at(0);
  std::vector<DepthSample> samples;
  samples.reserve(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector2d pixel = reference.camera.project({points.ray_x[i], points.ray_y[i], 1});
    samples.push_back({pixel.cast<float>(), points.inverse_depth[i]});
  }
  return samples;
}

// A torn or half covered image may still get a pose, with a residual above that of the frame
// before. Where the motion does not lead there it is wrong; else a part of the image has told it,
// and the rest would bend the map.
constexpr double kDoubtful = 1.5;    // times the residual before, together with the next
constexpr double kSurprising = 2.5;  // [standard deviations]
constexpr double kUnfit = 2.2;       // times the largest residual of late
constexpr double kMemory = 0.9;      // of it, a frame

/// A map that falls apart loses rotations first: of 4,600 frames after the dense starts and 6,300
/// after held-out ones at most .15 degrees, and .4 within two frames where a map's scale is gone.
constexpr double kMaxRotationSigmaDeg = 0.4;  // intrinsics held

/// Residual that grey levels of 8 bits have even of equal images, rather more [grey levels].
constexpr double kRounding = 0.5;

/// Least share of the matches behind a pose that still agree once it is aligned to the image.
constexpr double kMinAgreeing = 0.7;
/// Share of all matches that agree with a pose: of those of another place .22 to .43 did, of right
/// ones .53 to .96.
constexpr double kMinShare = 0.5;
/// The same where the residual has grown: of a torn image two thirds may show another moment.
constexpr double kMinStanding = 0.75;
/// Flow since the keyframe, of width + height, beyond which a low residual may be that of another
/// pose: matches that mostly agree are asked.
constexpr double kFarFlow = 0.027;

/// What a frame at a share of the map's reach gets of its keyframe's covariance.
struct ErrorsOfMap {
  ErrorsOfMap(const KeyframePose& keyframe, const Matrix6d& covariance, const SE3& T_cam_keyframe)
      : share(T_cam_keyframe.translation().norm() / keyframe.reach) {
    const Matrix6d adjoint = T_cam_keyframe.adjoint();
    of_keyframe = adjoint * covariance * adjoint.transpose();
  }
  [[nodiscard]] Matrix6d ofWorldPose(const Matrix6d& tracked) const {
    return tracked + (1 + share) * (1 + share) * of_keyframe;
  }
  double share;
  Matrix6d of_keyframe;
};

}  // namespace

std::optional<MatchEvidence> MatchedPoses::find(const FramePtr& frame,
                                                const track::TrackingReference& reference) {
  if (host_frame_ != reference.frame) {
    host_frame_ = reference.frame;
    mean_ = meanIntensity(*host_frame_);
    const bool described = frame_ == host_frame_ && described_.gain == 1;
    points_ = describePoints(described ? described_ : describeFrame(host_frame_, 1),
                             samplesOf(reference));
  }
  if (frame_ != frame) {
    frame_ = frame;
    described_ = describeFrame(frame, gainTowards(mean_, *frame));
  }
  MatchEvidence evidence;
  evidence.matches = matchPoints(points_, described_, reference.camera);
  std::optional<MatchedPose> pose = poseFromMatches(evidence.matches, reference.camera, seed_);
  if (!pose) return std::nullopt;
  evidence.pose = std::move(*pose);
  return evidence;
}

FrameTracker::FrameTracker(const OdometryOptions& options)
    : options_(options),
      tracker_(
          options.tracker, options.brightness, !options.initializer.skip.has(Mechanism::kGrey)),
      matched_(static_cast<std::uint64_t>(options.initializer.seed)) {}

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
  exposure_ = result.frames.back().frame->exposure();
  rmse_ = track::TrackingStart{}.previous_rmse;
  largest_rmse_.reset();
  missed_ = false;
}

void FrameTracker::setTarget(TrackingTarget target) {
  if (target_) {
    history_ = history_.relativeTo(target.T_cam_previous);
    recent_.changeReference(target.T_cam_previous);
  }
  target_ = std::move(target.keyframe);
  tracker_.setReference(std::move(target.reference));
  if (reference().frame->id() == previous_) affine_ = reference().affine;
}

track::TrackingStart FrameTracker::startOf(const Frame& frame) const {
  return {track::motionGuesses(history_, frame.timestamp()),
          affine_,
          rmse_,
          options_.tracker.max_gain_step,
          recent_.poses(),
          recent_.sigma()};
}

bool FrameTracker::counts(const Frame& frame,
                          const track::TrackingResult& result,
                          bool may_doubt) const {
  const Skips& skip = options_.initializer.skip;
  if (!result.good()) return false;
  if (!skip.has(Mechanism::kUncertain) && !isCertain(result)) return false;
  if (missed_ && !skip.has(Mechanism::kProof)) return isAtLevel(frame, result);
  return !may_doubt || skip.has(Mechanism::kDoubtful) || !isDoubtful(frame, result);
}

std::optional<track::TrackingResult> FrameTracker::fromMatches(const FramePtr& frame) {
  const std::optional<MatchEvidence> evidence = matched_.find(frame, reference());
  if (!evidence) return std::nullopt;
  track::TrackingStart start = startOf(*frame);
  start.guesses = {evidence->pose.T_cam_host};
  track::TrackingResult result = tracker_.track(*frame, start);
  const int agreeing = countAgreeing(evidence->matches, reference().camera, result.T_cur_ref);
  if (!result.good() || agreeing < kMinAgreeing * evidence->pose.inliers) return std::nullopt;
  const double share = evidence->pose.inliers / static_cast<double>(evidence->matches.size());
  const bool stands = share > kMinStanding || (share > kMinShare && isAtLevel(*frame, result));
  return stands ? std::optional(result) : std::nullopt;
}

bool FrameTracker::isContradicted(const FramePtr& frame, const track::TrackingResult& result) {
  const double far = kFarFlow * (frame->width() + frame->height());
  if (result.flow.full < far * far) return false;
  const std::optional<MatchEvidence> evidence = matched_.find(frame, reference());
  if (!evidence) return false;
  const MatchedPose& matched = evidence->pose;
  const int agreeing = countAgreeing(evidence->matches, reference().camera, result.T_cur_ref);
  return matched.inliers > kMinStanding * static_cast<double>(evidence->matches.size()) &&
         agreeing < kMinAgreeing * matched.inliers;
}

TrackedPose FrameTracker::track(const FramePtr& frame, bool may_doubt) {
  track::TrackingResult result = tracker_.track(*frame, startOf(*frame));
  TrackedPose pose;
  pose.good = counts(*frame, result, may_doubt);
  const Skips& skip = options_.initializer.skip;
  if (pose.good && !skip.has(Mechanism::kProof)) pose.good = !isContradicted(frame, result);
  if (!pose.good && !skip.has(Mechanism::kMatches) &&
      result.failure != track::TrackingFailure::kBlank) {
    if (auto matched = fromMatches(frame)) {
      result = std::move(*matched);
      pose.good = skip.has(Mechanism::kUncertain) || isCertain(result);
    }
  }
  if (std::isfinite(result.rmse[0])) pose.rmse = result.rmse[0];
  if (!pose.good) {
    missed_ = true;
    return pose;
  }
  setPose(result, pose);
  pose.fits = skip.has(Mechanism::kUnfit) || !may_doubt || !largest_rmse_ ||
              inEarlierContrast(*frame, result) < kUnfit * *largest_rmse_;
  if (pose.fits) noteFit(*frame, result);
  pose.wants_keyframe = pose.fits && needsKeyframe(*frame, result);
  noteMotion(*frame, pose);
  addErrorsOfCamera(pose);
  return pose;
}

void FrameTracker::setPose(const track::TrackingResult& result, TrackedPose& pose) const {
  pose.keyframe = reference().frame->id();
  pose.T_cam_keyframe = result.T_cur_ref;
  pose.covariance = result.covariance;
  pose.T_cam_world = result.T_cur_ref * target_->T_cam_world;
  pose.affine = result.affine;
  pose.motion = result.motion;
  addErrorsOfMap(pose);
}

bool FrameTracker::isCertain(const track::TrackingResult& result) const {
  const std::optional<Matrix6d>& held = target_->covariance_camera_held;
  if (!result.covariance || !held || !(target_->reach > 0)) return true;
  const ErrorsOfMap errors(*target_, *held, result.T_cur_ref);
  const Matrix6d covariance = errors.ofWorldPose(*result.covariance);
  const double variance = covariance.diagonal().tail<3>().maxCoeff();
  return std::sqrt(variance) < kMaxRotationSigmaDeg * kRadPerDeg;
}

bool FrameTracker::isAtLevel(const Frame& frame, const track::TrackingResult& result) const {
  return inEarlierContrast(frame, result) < std::max(kDoubtful * rmse_, kRounding);
}

bool FrameTracker::isDoubtful(const Frame& frame, const track::TrackingResult& result) const {
  if (inEarlierContrast(frame, result) < kDoubtful * rmse_) return false;
  const TimedPose pose{frame.timestamp(), result.T_cur_ref};
  return recent_.surprise(pose).value_or(0) > kSurprising;
}

void FrameTracker::noteMotion(const Frame& frame, TrackedPose& pose) {
  const TimedPose timed{frame.timestamp(), pose.T_cam_keyframe};
  recent_.push({timed, pose.motion.velocity});
  pose.rows = recent_.atEnd();
  if (recent_.size() > 1) {
    pose.previous = previous_;
    pose.previous_rows = recent_.inMiddle();
  }
  history_.push(timed);
  previous_ = frame.id();
}

void FrameTracker::noteFit(const Frame& frame, const track::TrackingResult& result) {
  rmse_ = result.rmse[0];
  largest_rmse_ = std::max(rmse_, kMemory * largest_rmse_.value_or(0));
  missed_ = false;
  affine_ = result.affine;
  exposure_ = frame.exposure();
}

void FrameTracker::addErrorsOfMap(TrackedPose& pose) const {
  if (!pose.covariance || !target_->covariance || !(target_->reach > 0)) return;
  const ErrorsOfMap errors(*target_, *target_->covariance, pose.T_cam_keyframe);
  pose.world_covariance = errors.ofWorldPose(*pose.covariance);
  *pose.covariance +=
      variance_factors::kMapShare * errors.share * errors.share * errors.of_keyframe;
}

void FrameTracker::addErrorsOfCamera(TrackedPose& pose) const {
  if (!(target_->doubt > 0)) return;
  const auto errors = [&](const SE3& motion) {
    const Vector6d moved = motion.log();
    Vector6d variances;
    variances.head<3>().setConstant(moved.head<3>().squaredNorm() / 3);
    variances.tail<3>().setConstant(moved.tail<3>().squaredNorm() / 3);
    return Matrix6d((target_->doubt * target_->doubt * variances).asDiagonal());
  };
  if (pose.covariance) *pose.covariance += errors(pose.T_cam_keyframe);
  if (pose.world_covariance) {
    *pose.world_covariance += errors(pose.T_cam_keyframe * target_->T_cam_middle);
  }
}

double FrameTracker::inEarlierContrast(const Frame& frame,
                                       const track::TrackingResult& result) const {
  const double gain = brightnessTransfer(affine_, exposure_, result.affine, frame.exposure()).gain;
  return result.rmse[0] / std::max(gain, 1.0);
}

bool FrameTracker::needsKeyframe(const Frame& frame, const track::TrackingResult& result) const {
  const track::TrackingReference& target = reference();
  window::KeyframeCues cues;
  cues.translation_flow = result.flow.translation;
  cues.full_flow = result.flow.full;
  cues.log_gain = std::log(
      brightnessTransfer(target.affine, target.frame->exposure(), result.affine, frame.exposure())
          .gain);
  cues.width_plus_height = frame.width() + frame.height();
  return window::needsKeyframe(cues, options_.window);
}

}  // namespace dsorb::odometry
