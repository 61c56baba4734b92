// SPDX-License-Identifier: BSD-3-Clause
#include "odometry/mapper.h"

#include "base/parallel.h"
#include "base/timed.h"
#include "odometry/seed_window.h"
#include "window/keyframe_policy.h"
#include "window/marginalization.h"
#include "window/point_activation.h"
#include "window/window_step.h"

#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <cstddef>
#include <stdexcept>
#include <utility>

namespace dsorb::odometry {
namespace {

// Keyframes of a segment after which the calibration is looked at: enough of them to tell it, and
// structure not yet bent to what is wrong with it.
constexpr std::array<int, 3> kScored{4, 6, 8};

PixelSelectorOptions selectorOptions(const OdometryOptions& options) {
  PixelSelectorOptions selector;
  selector.seed = options.initializer.seed;
  return selector;
}

/// Largest distance of the newest keyframe from another one.
double reachOf(const window::Window& window) {
  const auto centre = [](const window::Keyframe& k) {
    return k.T_cam_world().inverse().translation();
  };
  const Eigen::Vector3d newest = centre(window.keyframes.back());
  double reach = 0;
  for (const window::Keyframe& keyframe : window.keyframes) {
    reach = std::max(reach, (centre(keyframe) - newest).norm());
  }
  return reach;
}

}  // namespace

Mapper::Mapper(const PinholeCamera& camera, const OdometryOptions& options)
    : camera_(camera),
      options_(options),
      selector_(camera.width, camera.height, selectorOptions(options)),
      optimizer_(options.window),
      reference_builder_(camera) {}

MapUpdate Mapper::seed(const InitializationResult& result, int segment) {
  selector_.reset();
  segment_ = segment;
  readout_.reset();
  camera_sigmas_.reset();
  radial_.reset();
  camera_score_.reset();
  scored_ = -1;
  innovations_ = {};
  stuck_ = StuckRegions(result.stuck, camera_.width, camera_.height);
  window_ = seedWindow(result, camera_, options_, selector_);
  const StartComparison comparison(result, *window_);
  MapUpdate update = adjust(SE3());
  if (update.finite) update.start_change = comparison.change(*window_, noise_);
  update.new_keyframes = window_->next_keyframe;
  return update;
}

std::unique_ptr<MapUpdate> Mapper::map(const MappingJob& job) {
  if (!window_) throw std::logic_error("Mapper::map without a map");
  const window::TrackedFrame tracked{job.frame, poseOf(job.pose), job.pose.affine, job.pose.motion};
  window::Keyframe& newest = window_->keyframes.back();
  if (newest.frame->id() == job.pose.previous) newest.expect(job.pose.previous_rows);
  window::refineCandidates(*window_, tracked, options_.depth);
  if (!job.becomes_keyframe) return nullptr;
  window::flagLeaving(*window_, options_.window);
  window::addKeyframe(*window_, tracked.frame, tracked.T_cam_world, tracked.affine, options_.window)
      .setMotion(tracked.motion, job.pose.rows);
  window::activateCandidates(*window_, options_.window, options_.depth);
  return std::make_unique<MapUpdate>(adjust(job.pose.T_cam_keyframe));
}

/// World pose of a tracked frame: its keyframe may have moved since the frame was tracked.
SE3 Mapper::poseOf(const TrackedPose& pose) const {
  const auto& keyframes = window_->keyframes;
  const auto host =
      std::find_if(keyframes.rbegin(), keyframes.rend(), [&pose](const window::Keyframe& keyframe) {
        return keyframe.frame->id() == pose.keyframe;
      });
  return host == keyframes.rend() ? pose.T_cam_world : pose.T_cam_keyframe * host->T_cam_world();
}

MapUpdate Mapper::adjust(const SE3& T_cam_previous) {
  MapUpdate update;
  update.new_keyframes = 1;
  window::OptimizationReport adjustment;
  runBoth(
      [&] { adjustment = optimizer_.optimize(*window_); },
      [&] {
        selectCandidates(
            window_->keyframes.back(), selector_, stuck_, options_.depth.candidates_per_keyframe);
      });
  update.finite = adjustment.finite && adjustment.residuals > 0;
  if (!update.finite) return update;
  noise_ = adjustment.rms;
  noteCamera(adjustment.uncertainty.camera_sigmas);
  if (!options_.initializer.skip.has(Mechanism::kCameraScore)) scoreCamera();
  update.target = targetOf(T_cam_previous);
  update.target.keyframe.covariance = adjustment.uncertainty.newest_pose;
  update.target.keyframe.covariance_camera_held = adjustment.uncertainty.newest_pose_camera_held;
  update.target.keyframe.reach = reachOf(*window_);
  update.target.keyframe.doubt = camera_score_ ? camera_score_->motionError(window_->camera()) : 0;
  const std::vector<DepthSample> samples = window::depthSamples(*window_, options_.window);
  if (!options_.initializer.skip.has(Mechanism::kExpected)) {
    window::expectDepths(window_->keyframes.back(), samples);
  }
  runBoth([&] { reference_builder_.fill(samples, update.target.reference); },
          [&] {
            window::forgetGuess(*window_, options_.window);
            window::retirePoints(*window_, options_.window);
            for (const auto& keyframe : window::marginalizeFlagged(*window_, options_.window)) {
              update.retired.push_back(snapshot(keyframe));
            }
            update.window = snapshots();
          });
  return update;
}

/// The newest keyframe; points are still to come.
TrackingTarget Mapper::targetOf(const SE3& T_cam_previous) const {
  const window::Keyframe& newest = window_->keyframes.back();
  const window::Keyframe& middle = window_->keyframes[window_->keyframes.size() / 2];
  TrackingTarget target{{newest.T_cam_world()}, {}, T_cam_previous};
  target.keyframe.T_cam_middle = newest.T_cam_world() * middle.T_cam_world().inverse();
  target.reference.frame = newest.frame;
  target.reference.camera = window_->camera();
  target.reference.affine = newest.affine();
  target.reference.motion = newest.motion;
  target.reference.change = window_->change();
  return target;
}

/// What the adjustment has estimated of the camera.
void Mapper::noteCamera(const window::CameraVector& sigmas) {
  const CameraChange change = window_->change();
  const double sigma = sigmas[window::kReadout];
  if (sigma > 0) {
    const double readout = window_->calibratedReadout().seconds + change.readout;
    readout_ = {readout, sigma * innovations_.update(readout, sigma)};
  }
  if (sigmas[0] > 0) camera_sigmas_ = {sigmas[0], sigmas[1], sigmas[2], sigmas[3]};
  const double radial = sigmas[window::kRadial];
  if (radial > 0) radial_ = {change.radial, radial};
}

/// Looks whether the images contradict the calibration.
void Mapper::scoreCamera() {
  const int newest = window_->keyframes.back().id.value;
  const auto due = std::find_if(
      kScored.begin(), kScored.end(), [&](int keyframe) { return keyframe > scored_; });
  if (due == kScored.end() || newest < *due || options_.window.optimizer.optimize_intrinsics)
    return;
  scored_ = newest;
  const CameraScore score = window::scoreCamera(*window_, options_.window, noise_);
  if (!camera_score_ || score.deviations() > camera_score_->deviations()) camera_score_ = score;
}

std::vector<KeyframeSnapshot> Mapper::clear() {
  if (!window_) return {};
  std::vector<KeyframeSnapshot> keyframes = snapshots();
  window_.reset();
  return keyframes;
}

std::vector<KeyframeSnapshot> Mapper::snapshots() const {
  std::vector<KeyframeSnapshot> keyframes;
  for (const window::Keyframe& keyframe : window_->keyframes) {
    keyframes.push_back(snapshot(keyframe));
  }
  return keyframes;
}

/// A keyframe as observers see it: its points, those of the adjustment and those that left it with
/// their information kept.
KeyframeSnapshot Mapper::snapshot(const window::Keyframe& keyframe) const {
  KeyframeSnapshot shot;
  shot.id = keyframe.frame->id();
  shot.timestamp = keyframe.frame->timestamp();
  shot.segment = segment_;
  shot.T_world_cam = keyframe.T_cam_world().inverse();
  shot.affine = keyframe.affine();
  shot.camera = window_->camera();
  shot.readout = readout_;
  shot.camera_sigmas = camera_sigmas_;
  shot.radial = radial_;
  shot.camera_score = camera_score_;
  shot.points.reserve(keyframe.points.size() + keyframe.marginalized.size());
  const auto add = [&](const window::WindowPoint& point) {
    shot.points.push_back(
        {point.patch.pixel, point.inverse_depth, point.variance, point.patch.grey[kPatternCenter]});
  };
  for (const window::WindowPoint& point : keyframe.marginalized) add(point);
  for (const window::WindowPoint& point : keyframe.points) {
    if (point.variance > 0 && point.inverse_depth > 0) add(point);
  }
  return shot;
}

AsyncMapper::AsyncMapper(const PinholeCamera& camera,
                         const OdometryOptions& options,
                         TaskArena& arena)
    : own_arena_(options.num_threads),
      arena_(options.pipelined ? own_arena_ : arena),
      mapper_(camera, options),
      queue_([this](const MappingJob& job) { return run([&] { return mapper_.map(job); }); },
             options.pipelined ? options.max_waiting : 0) {}

template <typename Work>
MappingResult AsyncMapper::run(const Work& work) {
  MappingResult result;
  timed(result.seconds, [&] { result.update = arena_.run(work); });
  return result;
}

MappingResult AsyncMapper::seed(const InitializationResult& result, int segment) {
  return run([&] { return std::make_unique<MapUpdate>(mapper_.seed(result, segment)); });
}

void AsyncMapper::submit(MappingJob job) {
  keyframe_is_due_ |= job.becomes_keyframe;
  queue_.submit(std::move(job));
}

std::optional<MappingResult> AsyncMapper::take() {
  std::optional<MappingResult> result = queue_.take();
  if (result && result->update) keyframe_is_due_ = false;
  return result;
}

std::vector<KeyframeSnapshot> AsyncMapper::clear() {
  queue_.discard();
  keyframe_is_due_ = false;
  return mapper_.clear();
}

}  // namespace dsorb::odometry
