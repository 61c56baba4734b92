// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/io/writers.h"

#include "io/output/output_file.h"
#include "support/text_files.h"

#include <filesystem>
#include <limits>
#include <vector>

namespace dsorb {

inline const PinholeCamera kCamera{100, 100, 79.5, 59.5, 160, 120};

inline io::Json readJson(const std::filesystem::path& path) {
  return io::Json::parse(readText(path));
}

inline FramePtr makeFrame(int index) {
  std::vector<float> pixels(160 * 120);
  for (std::size_t i = 0; i < pixels.size(); ++i) {
    pixels[i] = static_cast<float>(i % 160) + 0.5F * static_cast<float>(i / 160 % 2);
  }
  FrameInfo info;
  info.id = {index};
  info.timestamp = 0.1 * index;
  return Frame::create(ImageView(pixels.data(), 160, 120), info);
}

inline SE3 translated(double z) {
  return {Eigen::Quaterniond::Identity(), Eigen::Vector3d(0, 0, z)};
}

/// Camera that moves 0.1 forward a frame: T_cam_ref of the frame `steps` after the reference.
inline SE3 forward(int steps) {
  return translated(-0.1 * steps);
}

inline InitializationResult makeResult(const std::vector<FramePtr>& frames) {
  InitializationResult result;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    PosedFrame posed;
    posed.frame = frames[i];
    posed.T_cam_ref = forward(static_cast<int>(i));
    posed.covariance = Matrix6d(1e-4 * Matrix6d::Identity());
    result.frames.push_back(posed);
  }
  for (int i = 0; i < 40; ++i) {
    const float x = 10.0F + 3.5F * static_cast<float>(i);
    result.points.push_back({0, {x, 60}, 0.5F + 0.025F * static_cast<float>(i), 0.01F, 3});
  }
  result.points.push_back({1, {20, 20}, 1, 0.01F, 3});  // hosted elsewhere
  result.report.model = "fundamental";
  result.report.stages = {{"tracking", 1.5}};
  result.report.add("residual_rms", std::numeric_limits<double>::quiet_NaN());
  return result;
}

/// Plays the part of Odometry towards the observer.
class FakeRun {
 public:
  explicit FakeRun(const std::filesystem::path& folder) : writer(folder.string(), info()) {
    writer.setCamera(kCamera);
  }

  static RunInfo info() {
    RunInfo info;
    info.program = "test";
    info.version = "1.2.3";
    info.dataset = "a \"quoted\" name";
    info.initializer = "orb-v1";
    info.config_yaml = "num_threads: 1\n";
    return info;
  }

  void initializing(int index, InitStatus status = InitStatus::kNeedsMoreFrames) {
    fed_.push_back(makeFrame(index));
    InitStep step;
    step.status = status;
    step.reason = InitReason::kTooLittleParallax;
    writer.onInitStep(step, *fed_.back(), segment);
    if (status == InitStatus::kRestarted) fed_.erase(fed_.begin(), fed_.end() - 1);
    finishFrame(fed_.back(), OdometryState::kInitializing);
  }

  /// A frame whose image is that of an earlier one, while nothing has started.
  void repeated(int index, int of) {
    FrameEstimate estimate;
    estimate.frame = makeFrame(index);
    estimate.repeats = FrameId{of};
    writer.onFrame(estimate);
    writer.frameDone({3, 1});
  }

  /// A start that the window refuses.
  void refused(int index, const StartChange& change) {
    addResult(index);
    writer.onStartRefused({fed_.back()->id(), segment, RefusalReason::kDepth, change});
    finishFrame(fed_.back(), OdometryState::kInitializing);
    fed_.clear();
  }

  void initialized(int index) {
    addResult(index);
    reference_ = fed_.front();
    keyframe(SE3());
    FrameEstimate estimate = posed(fed_.back(), OdometryState::kInitialized);
    writer.onFrame(estimate);
    writer.frameDone({20, 1});
    fed_.clear();
  }

  void tracked(int index) {
    FrameEstimate estimate = posed(makeFrame(index), OdometryState::kTracked);
    estimate.tracking_rmse = 5.25;
    writer.onFrame(estimate);
    writer.frameDone({4, 1});
  }

  /// Tracked against the reference, then moved by the adjustment.
  void trackedKeyframe(int index, const SE3& T_world_cam) {
    FrameEstimate estimate = posed(makeFrame(index), OdometryState::kTracked);
    estimate.tracking_rmse = 5.25;
    estimate.is_keyframe = true;
    estimate.T_world_cam = T_world_cam;
    const Frame& frame = *estimate.frame;
    writer.onKeyframe({frame.id(), frame.timestamp(), segment, T_world_cam, {}, kCamera, {}});
    writer.onFrame(estimate);
    writer.frameDone({4, 1});
  }

  void lost(int index) {
    finishFrame(makeFrame(index), OdometryState::kLost);
    retire();
    ++segment;
  }

  void keyframe(const SE3& T_world_cam) {
    snapshot_ = {reference_->id(), reference_->timestamp(), segment, T_world_cam, {}, kCamera, {}};
    snapshot_.points = {{{79.5F, 59.5F}, 0.5F, 0.01F, 100}, {{30, 30}, 1, 0.02F, 300}};
    writer.onKeyframe(snapshot_);
  }
  void retire() { writer.onKeyframeRetired(snapshot_); }

  RunWriter writer;
  std::vector<Detail> details;  ///< of the report of starts, beside others
  int segment = 0;

 private:
  void addResult(int index) {
    fed_.push_back(makeFrame(index));
    InitStep step;
    step.status = InitStatus::kInitialized;
    step.reason = InitReason::kDone;
    step.result = makeResult(fed_);
    for (const Detail& detail : details) step.result->report.details.push_back(detail);
    writer.onInitStep(step, *fed_.back(), segment);
  }
  FrameEstimate posed(const FramePtr& frame, OdometryState state) const {
    FrameEstimate estimate;
    estimate.frame = frame;
    estimate.state = state;
    estimate.segment = segment;
    estimate.T_cam_keyframe = forward(frame->id().value - reference_->id().value);
    estimate.T_world_cam = estimate.T_cam_keyframe->inverse();
    estimate.keyframe = reference_->id();
    return estimate;
  }
  void finishFrame(const FramePtr& frame, OdometryState state) {
    FrameEstimate estimate;
    estimate.frame = frame;
    estimate.state = state;
    estimate.segment = segment;
    writer.onFrame(estimate);
    writer.frameDone({3, 1});
  }

  std::vector<FramePtr> fed_;
  FramePtr reference_;
  KeyframeSnapshot snapshot_;
};

/// Frames 0 to 2 initialize, 3 and 4 are tracked.
inline void playOneSegment(FakeRun& run) {
  run.initializing(0);
  run.initializing(1);
  run.initialized(2);
  run.tracked(3);
  run.tracked(4);
}

}  // namespace dsorb
