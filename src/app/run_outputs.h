// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/io/writers.h"

#include "app/command_line.h"
#include "io/output/recording_writer.h"

#include <chrono>
#include <mutex>
#include <optional>
#include <string>

namespace dsorb::app {

/// Everything that a run writes. Two threads may ask for the end: the run's own, and the one that
/// ends a program that does not answer an interrupt; whatever was told until then is written.
class RunOutputs : public OdometryObserver {
 public:
  RunOutputs(const CommandLine& request, RunInfo info);

  /// Prepares the output folder, and the recording where one is wanted.
  void open(const PinholeCamera& camera, const Lens& lens, const std::string& config_yaml);

  /// The camera that earlier passes found; after open().
  void setFoundCamera(const FoundCamera& camera);

  void onInitStep(const InitStep& step, const Frame& frame, int segment) override {
    last_answer_ = step.reason;
    tell(&OdometryObserver::onInitStep, step, frame, segment);
  }
  void onFrame(const FrameEstimate& estimate) override {
    tell(&OdometryObserver::onFrame, estimate);
  }
  void onKeyframe(const KeyframeSnapshot& keyframe) override {
    tell(&OdometryObserver::onKeyframe, keyframe);
  }
  void onKeyframeRetired(const KeyframeSnapshot& keyframe) override {
    tell(&OdometryObserver::onKeyframeRetired, keyframe);
  }
  void onStartRefused(const StartRefusal& refusal) override {
    tell(&OdometryObserver::onStartRefused, refusal);
  }
  void onLost(FrameId frame, int segment) override {
    tell(&OdometryObserver::onLost, frame, segment);
  }
  void onSegmentsJoined(const SegmentsJoined& joined) override {
    tell(&OdometryObserver::onSegmentsJoined, joined);
  }
  void onLoopsClosed(const LoopsClosed& closed) override {
    tell(&OdometryObserver::onLoopsClosed, closed);
  }
  void onTracks(const std::vector<MapTrack>& tracks) override {
    tell(&OdometryObserver::onTracks, tracks);
  }

  void frameDone(const FrameTiming& timing,
                 const FrameEstimate& estimate,
                 const std::string& image_file);
  void setDropped(int frames);
  void setUnreadable(const std::vector<std::string>& files);

  /// Writes the final files; before open() these say that nothing was computed.
  void finish(RunStatus status, const OdometryReport* report);
  /// The same within `patience`, for a run that was interrupted and does not come to its end.
  /// Nobody writes anything afterwards.
  /// @return what happened; nothing where the run was busy writing: what lies there is valid
  [[nodiscard]] std::optional<RunStatus> finishNow(std::chrono::milliseconds patience);

  [[nodiscard]] RunStatus outcome() const;
  /// What the initializer said last.
  [[nodiscard]] InitReason lastAnswer() const { return last_answer_; }
  [[nodiscard]] bool calibrationSuspected() const { return run_ && run_->calibrationSuspected(); }

 private:
  using Lock = std::lock_guard<std::timed_mutex>;
  template <typename Event, typename... What>
  void tell(Event event, const What&... what) {
    const Lock lock(mutex_);
    ((*run_).*event)(what...);
    if (recording_) ((*recording_).*event)(what...);
  }
  void finishLocked(RunStatus status, const OdometryReport* report);

  std::string folder_;
  std::string record_;
  bool write_result_txt_;
  RunInfo info_;
  mutable std::timed_mutex mutex_;
  std::optional<RunWriter> run_;
  std::optional<io::RecordingWriter> recording_;
  InitReason last_answer_ = InitReason::kFirstFrame;
};

}  // namespace dsorb::app
