// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/odometry/observer.h"

#include <deque>
#include <map>
#include <optional>
#include <utility>
#include <vector>

namespace dsorb::io {

/// What became of a run's segments after they were told: joins and loops.
struct MapChanges {
  std::vector<SegmentsJoined> joins;
  std::vector<LoopsClosed> loops;
  std::map<FrameId, Similarity> moved;  ///< by keyframe: S_new_old of loops, after the joins

  void add(const SegmentsJoined& joined) { joins.push_back(joined); }
  void add(const LoopsClosed& closed) {
    loops.push_back(closed);
    for (const KeyframeMoved& keyframe : closed.moved) moved[keyframe.id] = keyframe.S_new_old;
  }
  [[nodiscard]] bool empty() const { return joins.empty() && loops.empty(); }

  /// The segment that has become of one.
  [[nodiscard]] int segmentOf(int segment) const {
    for (const SegmentsJoined& joined : joins) {
      if (joined.segment == segment) segment = joined.into;
    }
    return segment;
  }
  /// World of now from the world in which something was told, around a keyframe of the segment.
  [[nodiscard]] Similarity changeOf(int segment, FrameId keyframe) const {
    Similarity change;
    for (const SegmentsJoined& joined : joins) {
      if (joined.segment != segment) continue;
      change = joined.S_into_segment * change;
      segment = joined.into;
    }
    const auto by_loops = moved.find(keyframe);
    return by_loops == moved.end() ? change : by_loops->second * change;
  }
};

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

using Entries = std::deque<PosedEntry>;  ///< a vector would move, and need twice the room

/// A call of the initializer.
struct InitStepNote {
  InitStatus status = InitStatus::kNeedsMoreFrames;
  InitReason reason = InitReason::kFirstFrame;
  int segment = 0;
  std::optional<InitializationResult> result;
  std::optional<StartRefusal> refusal;  ///< of its result
};

/// Numbers of a whole run.
struct RunFacts {
  int frames_given = 0;
  OdometryState last_state = OdometryState::kInitializing;  ///< after the newest frame
  int frames_tracked = 0;
  int frames_missed = 0;  ///< without a pose while a map stood
  /// Segments with a start that stayed, and not joined to another one, with their unit: metres of
  /// the start's unit; where there is one, all of the segment is told in metres.
  std::map<int, std::optional<MetricScale>> segments;
  /// What a start that took all rows for exposed at one time says of the readout, where that is not
  /// 0 by more than three standard deviations; the surest of them.
  std::optional<Readout> suspected_readout;
  /// What the window that contradicts the calibration most says of the camera, where one does.
  std::optional<CameraScore> contradicted_camera;
  double stuck_share = 0;  ///< largest of a start's corners that moved with the camera, as a bonnet
  std::map<RefusalReason, int> refusals;  ///< of starts
  std::map<InitReason, int> answers;      ///< of the initializer
};

/// Record of a run: enough to write every trajectory with the poses that are final by then. It
/// keeps about 110 bytes a frame and 200 a keyframe; images are not kept beyond the current frame.
class RunRecord {
 public:
  void addInitStep(const InitStep& step, int segment);
  void addRefusal(const StartRefusal& refusal);
  void addFrame(const FrameEstimate& estimate);
  void addKeyframe(const KeyframeSnapshot& keyframe);
  /// From here on poses are those after the join: nothing of the moved segment may follow.
  void addJoin(const SegmentsJoined& joined);
  /// The same after loops were closed.
  void addLoops(const LoopsClosed& closed) { changes_.add(closed); }
  [[nodiscard]] const MapChanges& changes() const { return changes_; }
  /// Forgets everything that belongs to the current frame only.
  void nextFrame();

  /// Segment of an entry, after all joins.
  [[nodiscard]] int segmentOf(const PosedEntry& entry) const {
    return changes_.segmentOf(entry.segment);
  }
  /// World (reference camera of the segment) from camera, by the present estimates.
  [[nodiscard]] SE3 T_world_cam(const PosedEntry& entry) const;
  [[nodiscard]] const Entries& frames() const { return frames_; }
  [[nodiscard]] const Entries& keyframes() const { return keyframes_; }
  [[nodiscard]] const RunFacts& facts() const { return facts_; }
  /// The one with the most frames, the earliest of equals; -1 where no frame has a pose.
  [[nodiscard]] int longestSegment() const;
  /// Unit of one segment; nothing where it is not told in metres.
  [[nodiscard]] std::optional<MetricScale> unitOf(int segment) const;
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
  [[nodiscard]] std::pair<const Anchor*, double> nextOf(const PosedEntry& entry) const;

  Entries frames_;
  Entries keyframes_;            ///< each its own anchor
  std::vector<Repeat> repeats_;  ///< since the last start
  RunFacts facts_;
  std::vector<Start> starts_;
  std::map<FrameId, Anchor> anchors_;
  MapChanges changes_;

  std::vector<InitStepNote> steps_;
  std::optional<FrameEstimate> estimate_;
};

}  // namespace dsorb::io
