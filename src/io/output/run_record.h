// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/odometry/observer.h"

#include "io/output/map_changes.h"
#include "io/output/spool.h"

#include <filesystem>
#include <map>
#include <optional>
#include <vector>

namespace dsorb::io {

/// A frame with a pose, hung on an anchor: a keyframe or the reference of an initialization. Where
/// the next keyframe (the newest frame of the initialization) is known, it follows that one, too.
struct PosedEntry {
  FrameId id;
  double timestamp = 0;
  int segment = 0;
  FrameId anchor;
  SE3 T_cam_anchor;
  int start = -1;       ///< initialization it came with: the anchor is its reference; -1: none
  double progress = 0;  ///< from its reference to its newest frame, 0 to 1
};

/// Values of every frame that the figures need.
struct FrameNote {
  int index = 0;
  int segment = 0;
  OdometryState state = OdometryState::kInitializing;
  float milliseconds = 0;
  float tracking_rmse = 0;  ///< negative: there is none
};

using Entries = Spool<PosedEntry>;

/// A call of the initializer.
struct InitStepNote {
  InitStatus status = InitStatus::kNeedsMoreFrames;
  InitReason reason = InitReason::kFirstFrame;
  int segment = 0;
  std::optional<InitializationResult> result;
  std::optional<StartRefusal> refusal;  ///< of its result
};

/// Record of a run: enough to write every trajectory with the poses that are final by then. In
/// memory it keeps what belongs to the keyframes, about 200 bytes each; frames wait on the disk,
/// images are not kept beyond the current frame.
class RunRecord {
 public:
  /// @param folder on whose disk there is room for about 150 bytes a frame
  explicit RunRecord(const std::filesystem::path& folder);

  void addInitStep(const InitStep& step, int segment);
  void addRefusal(const StartRefusal& refusal);
  void addFrame(const FrameEstimate& estimate);
  void addKeyframe(const KeyframeSnapshot& keyframe);
  /// From here on poses are those after the join: nothing of the moved segment may follow.
  void addJoin(const SegmentsJoined& joined);
  /// The same after loops were closed.
  void addLoops(const LoopsClosed& closed) { changes_.add(closed); }
  [[nodiscard]] const MapChanges& changes() const { return changes_; }
  /// Completes the current frame's note.
  void setMilliseconds(double milliseconds);
  /// Forgets everything that belongs to the current frame only.
  /// @throws IoError where the disk is full
  void nextFrame();

  /// Segment of an entry, after all joins.
  [[nodiscard]] int segmentOf(const PosedEntry& entry) const {
    return changes_.segmentOf(entry.segment);
  }
  /// World (reference camera of the segment) from camera, by the present estimates.
  [[nodiscard]] SE3 T_world_cam(const PosedEntry& entry) const;
  [[nodiscard]] const Entries& frames() const { return frames_; }
  [[nodiscard]] const Entries& keyframes() const { return keyframes_; }
  [[nodiscard]] const Spool<FrameNote>& notes() const { return notes_; }
  [[nodiscard]] int framesTracked() const { return frames_tracked_; }
  /// Without a pose while a map stood.
  [[nodiscard]] int framesMissed() const { return frames_missed_; }
  /// Segments with a start that stayed, and that were not joined to another one.
  [[nodiscard]] const std::vector<int>& segments() const { return segments_; }
  /// The one with the most frames, the earliest of equals; -1 where no frame has a pose.
  [[nodiscard]] int longestSegment() const;
  /// Scale of each of them, in metres of its start's unit; where there is one, all of the segment
  /// is told in metres.
  [[nodiscard]] const std::vector<std::optional<MetricScale>>& units() const { return units_; }
  /// Unit of one segment; nothing where it is not told in metres.
  [[nodiscard]] std::optional<MetricScale> unitOf(int segment) const;
  /// What a start that took all rows for exposed at one time says of the readout, where that is not
  /// 0 by more than three standard deviations; the surest of them.
  [[nodiscard]] const std::optional<Readout>& suspectedReadout() const {
    return suspected_readout_;
  }
  /// What the window that contradicts the calibration most says of the camera, where one does.
  [[nodiscard]] const std::optional<CameraScore>& contradictedCamera() const {
    return contradicted_camera_;
  }
  /// Largest share of a start's corners that moved with the camera, as a bonnet does.
  [[nodiscard]] double stuckShare() const { return stuck_share_; }
  /// Number of starts that were refused.
  [[nodiscard]] int refusals(RefusalReason reason) const;
  /// How often the initializer gave each reason.
  [[nodiscard]] const std::map<InitReason, int>& answers() const { return answers_; }

  /// Steps of the initialization at the current frame.
  [[nodiscard]] const std::vector<InitStepNote>& steps() const { return steps_; }
  [[nodiscard]] const std::optional<FrameEstimate>& estimate() const { return estimate_; }

 private:
  /// Frames of an initialization and how far its two ends were apart.
  struct Start {
    FrameId newest;
    SE3 T_newest_reference;
  };
  /// A frame without a pose whose image is that of an earlier one, which may still get one.
  struct Repeat {
    FrameId id;
    double timestamp = 0;
    FrameId of;
  };
  /// What frames hang on: a keyframe, or the reference of an initialization.
  struct Anchor {
    explicit Anchor(const SE3& pose = {}, std::optional<double> time = {})
        : T_world_cam(pose), timestamp(time) {}
    SE3 T_world_cam;
    std::optional<double> timestamp;  ///< of its frame [s]
    bool is_keyframe = false;
    std::optional<FrameId> next;  ///< keyframe that was tracked against this one
    SE3 T_next_cam;               ///< and where it seemed to be then
  };
  /// Frames of a start, in the segment's unit.
  void addInitialization(InitializationResult result, int segment);
  void noteReadout(const InitializationResult& result);
  void noteStuck(const InitializationResult& result);
  void noteCamera(const KeyframeSnapshot& keyframe);
  /// As told, before joins and loops.
  [[nodiscard]] SE3 toldPose(const PosedEntry& entry) const;
  [[nodiscard]] SE3 T_cam_reference(const PosedEntry& entry, const Anchor& reference) const;
  [[nodiscard]] SE3 T_cam_keyframe(const PosedEntry& entry, const Anchor& keyframe) const;

  Entries frames_;
  Entries keyframes_;  ///< each its own anchor
  Spool<FrameNote> notes_;
  std::vector<Repeat> repeats_;  ///< since the last start
  int frames_tracked_ = 0;
  int frames_missed_ = 0;
  std::vector<Start> starts_;
  std::optional<Readout> suspected_readout_;
  double stuck_share_ = 0;
  std::optional<CameraScore> contradicted_camera_;
  std::map<FrameId, Anchor> anchors_;
  MapChanges changes_;
  std::vector<int> segments_;
  std::vector<std::optional<MetricScale>> units_;
  std::map<RefusalReason, int> refusals_;
  std::map<InitReason, int> answers_;

  std::vector<InitStepNote> steps_;
  std::optional<FrameEstimate> estimate_;
};

/// Whether rotation and translation hold neither nan nor infinity.
[[nodiscard]] bool isFinite(const SE3& pose);

}  // namespace dsorb::io
