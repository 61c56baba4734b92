// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/odometry/observer.h"

#include "io/output/output_file.h"

#include <algorithm>
#include <cstddef>
#include <filesystem>
#include <map>
#include <optional>
#include <string_view>
#include <utility>
#include <vector>

namespace dsorb::io {

/// A list of which only the newest records are in memory, the others in a nameless file.
/// @tparam Record its bytes are all there is to it: nothing it points to
template <typename Record>
class Spool {
 public:
  static constexpr std::size_t kBlock = 1024;  ///< so many of the newest records stay in memory

  /// @param folder on whose disk the old records lie
  explicit Spool(std::filesystem::path folder) : file_(std::move(folder)) {}

  [[nodiscard]] std::size_t size() const { return stored_ + newest_.size(); }
  [[nodiscard]] bool empty() const { return size() == 0; }

  /// The last record, where there is one.
  [[nodiscard]] Record& newest() { return newest_.back(); }
  [[nodiscard]] const Record& newest() const { return newest_.back(); }
  /// Any record; quick where the last one asked for was near. @throws IoError
  [[nodiscard]] Record at(std::size_t index) const {
    if (index >= stored_) return newest_[index - stored_];
    const std::size_t begin = index - index % kBlock;
    if (begin != block_begin_ || block_.empty()) {
      block_ = load(begin, std::min(kBlock, stored_ - begin));
      block_begin_ = begin;
    }
    return block_[index - begin];
  }

  void push(const Record& record) { newest_.push_back(record); }

  /// Puts all but the newest records on the disk. @throws IoError
  void settle() {
    if (newest_.size() < 2 * kBlock) return;
    const std::size_t count = newest_.size() - kBlock;
    file_.write(bytes(stored_), {reinterpret_cast<const char*>(newest_.data()), bytes(count)});
    newest_.erase(newest_.begin(), newest_.end() - kBlock);
    stored_ += count;
    block_.clear();
  }

 private:
  static constexpr std::size_t bytes(std::size_t records) { return records * sizeof(Record); }

  [[nodiscard]] std::vector<Record> load(std::size_t begin, std::size_t count) const {
    std::vector<Record> records(count);
    file_.read(bytes(begin), records.data(), bytes(count));
    return records;
  }

  NamelessFile file_;
  std::size_t stored_ = 0;  ///< records that are in the file
  std::vector<Record> newest_;
  mutable std::vector<Record> block_;  ///< of the file, read last
  mutable std::size_t block_begin_ = 0;
};

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

/// Numbers of a whole run.
struct RunFacts {
  int frames_tracked = 0;
  int frames_missed = 0;      ///< without a pose while a map stood
  std::vector<int> segments;  ///< with a start that stayed, and not joined to another one
  /// Scale of each of them, in metres of its start's unit; where there is one, all of the segment
  /// is told in metres.
  std::vector<std::optional<MetricScale>> units;
  /// What a start that took all rows for exposed at one time says of the readout, where that is not
  /// 0 by more than three standard deviations; the surest of them.
  std::optional<Readout> suspected_readout;
  /// What the window that contradicts the calibration most says of the camera, where one does.
  std::optional<CameraScore> contradicted_camera;
  double stuck_share = 0;  ///< largest of a start's corners that moved with the camera, as a bonnet
  std::map<RefusalReason, int> refusals;  ///< of starts
  std::map<InitReason, int> answers;      ///< of the initializer
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
  Entries keyframes_;  ///< each its own anchor
  Spool<FrameNote> notes_;
  std::vector<Repeat> repeats_;  ///< since the last start
  RunFacts facts_;
  std::vector<Start> starts_;
  std::map<FrameId, Anchor> anchors_;
  MapChanges changes_;

  std::vector<InitStepNote> steps_;
  std::optional<FrameEstimate> estimate_;
};

/// Whether rotation and translation hold neither nan nor infinity.
[[nodiscard]] bool isFinite(const SE3& pose);

}  // namespace dsorb::io
