// SPDX-License-Identifier: BSD-3-Clause
#include "io/run_record.h"

#include "geometry/reattachment.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iterator>

namespace dsorb::io {
namespace {

constexpr std::ptrdiff_t kMaxToldAgain = 1000;  // frames; upper limit of probation.max_frames

void removeSegment(std::vector<PosedEntry>& entries, int segment) {
  entries.erase(
      std::remove_if(entries.begin(),
                     entries.end(),
                     [segment](const PosedEntry& entry) { return entry.segment == segment; }),
      entries.end());
}

/// Replaces the entry with the same id among the last segment's, or appends.
void upsert(std::vector<PosedEntry>& entries, const PosedEntry& entry) {
  for (auto it = entries.rbegin(); it != entries.rend() && it->segment == entry.segment; ++it) {
    if (std::distance(entries.rbegin(), it) >= kMaxToldAgain) break;  // no window is that large
    if (it->id == entry.id) {
      *it = entry;
      return;
    }
  }
  entries.push_back(entry);
}

}  // namespace

bool isFinite(const SE3& pose) {
  return pose.unitQuaternion().coeffs().allFinite() && pose.translation().allFinite();
}

void RunRecord::addInitStep(const InitStep& step, int segment) {
  steps_.push_back({step.status, step.reason, segment, step.result, {}});
  if (step.result) addInitialization(*step.result, segment);
}

void RunRecord::addInitialization(const InitializationResult& result, int segment) {
  segments_.push_back(segment);
  const FrameId reference = result.frames.front().frame->id();
  T_world_anchor_[reference] = SE3();
  starts_.push_back({result.frames.back().frame->id(), *result.frames.back().T_cam_ref});
  const int start = static_cast<int>(starts_.size()) - 1;
  const auto last = static_cast<double>(result.frames.size() - 1);
  for (std::size_t i = 0; i < result.frames.size(); ++i) {
    const PosedFrame& posed = result.frames[i];
    if (!posed.T_cam_ref || !isFinite(*posed.T_cam_ref)) continue;
    frames_.push_back({posed.frame->id(),
                       posed.frame->timestamp(),
                       segment,
                       reference,
                       *posed.T_cam_ref,
                       start,
                       static_cast<double>(i) / last});
  }
}

void RunRecord::addRollback(const InitializationRollback& rollback) {
  const int segment = rollback.segment;
  for (const auto* entries : {&frames_, &keyframes_}) {
    for (const PosedEntry& entry : *entries) {
      if (entry.segment != segment) continue;
      T_world_anchor_.erase(entry.id);
      successors_.erase(entry.id);
    }
  }
  removeSegment(frames_, segment);
  removeSegment(keyframes_, segment);
  segments_.erase(std::remove(segments_.begin(), segments_.end(), segment), segments_.end());
  rollbacks_.push_back(rollback.reason);
  const auto start = std::find_if(steps_.begin(), steps_.end(), [](const InitStepNote& step) {
    return step.result && !step.rollback;
  });
  (start == steps_.end() ? rollback_ : start->rollback) = rollback;
}

int RunRecord::rollbacks(RollbackReason reason) const {
  return static_cast<int>(std::count(rollbacks_.begin(), rollbacks_.end(), reason));
}

void RunRecord::addFrame(const FrameEstimate& estimate) {
  estimate_ = estimate;
  const double rmse = estimate.tracking_rmse.value_or(-1);
  noteOf(estimate.frame->id().value) = {estimate.frame->id().value,
                                        estimate.segment,
                                        estimate.state,
                                        0,
                                        std::isfinite(rmse) ? static_cast<float>(rmse) : -1.0F};
  const bool placed =
      estimate.state == OdometryState::kTracked || estimate.state == OdometryState::kInitialized;
  if (!placed || !estimate.T_world_cam || !isFinite(*estimate.T_world_cam)) return;

  PosedEntry entry{
      estimate.frame->id(), estimate.frame->timestamp(), estimate.segment, FrameId{}, SE3(), -1, 0};
  if (estimate.keyframe && estimate.T_cam_keyframe && isFinite(*estimate.T_cam_keyframe)) {
    entry.anchor = *estimate.keyframe;
    entry.T_cam_anchor = *estimate.T_cam_keyframe;
    T_world_anchor_.try_emplace(entry.anchor, *estimate.T_world_cam * entry.T_cam_anchor);
    if (estimate.is_keyframe && entry.anchor != entry.id) {
      successors_[entry.anchor] = {entry.id, entry.T_cam_anchor};
    }
  } else {  // a keyframe is its own anchor
    entry.anchor = entry.id;
    T_world_anchor_.try_emplace(entry.id, *estimate.T_world_cam);
  }
  if (!frames_.empty() && frames_.back().id == entry.id) frames_.pop_back();  // came with a result
  frames_.push_back(entry);
}

/// Frames of a start that was rolled back are told again.
FrameNote& RunRecord::noteOf(int index) {
  for (auto note = notes_.rbegin(); note != notes_.rend(); ++note) {
    if (note->index == index) return *note;
    if (std::distance(notes_.rbegin(), note) >= kMaxToldAgain) break;
  }
  return notes_.emplace_back();
}

void RunRecord::addKeyframe(const KeyframeSnapshot& keyframe) {
  if (!isFinite(keyframe.T_world_cam)) return;
  T_world_anchor_[keyframe.id] = keyframe.T_world_cam;
  upsert(keyframes_,
         {keyframe.id, keyframe.timestamp, keyframe.segment, keyframe.id, SE3(), -1, 0});
}

void RunRecord::setMilliseconds(double milliseconds) {
  if (estimate_) notes_.back().milliseconds = static_cast<float>(milliseconds);
}

void RunRecord::nextFrame() {
  steps_.clear();
  estimate_.reset();
  rollback_.reset();
}

SE3 RunRecord::T_world_cam(const PosedEntry& entry) const {
  const auto own = T_world_anchor_.find(entry.id);  // the frame became a keyframe itself
  if (own != T_world_anchor_.end()) return own->second;
  const SE3 T_cam_anchor = entry.start < 0 ? T_cam_keyframe(entry) : T_cam_reference(entry);
  return T_world_anchor_.at(entry.anchor) * T_cam_anchor.inverse();
}

/// Pose of a frame of an initialization.
SE3 RunRecord::T_cam_reference(const PosedEntry& entry) const {
  const Start& start = starts_[static_cast<std::size_t>(entry.start)];
  const auto newest = T_world_anchor_.find(start.newest);
  if (newest == T_world_anchor_.end()) return entry.T_cam_anchor;
  const SE3 T_newest_anchor = newest->second.inverse() * T_world_anchor_.at(entry.anchor);
  return reattach(entry.T_cam_anchor, {start.T_newest_reference, T_newest_anchor}, entry.progress);
}

/// Pose of a tracked frame.
SE3 RunRecord::T_cam_keyframe(const PosedEntry& entry) const {
  const auto successor = successors_.find(entry.anchor);
  if (successor == successors_.end()) return entry.T_cam_anchor;
  const Successor& next = successor->second;
  const auto T_world_next = T_world_anchor_.find(next.id);
  if (T_world_next == T_world_anchor_.end()) return entry.T_cam_anchor;
  const SE3 T_next_anchor = T_world_next->second.inverse() * T_world_anchor_.at(entry.anchor);
  const double progress = static_cast<double>(entry.id.value - entry.anchor.value) /
                          static_cast<double>(next.id.value - entry.anchor.value);
  // Frames tracked while the next keyframe is made lie behind it.
  return spreadCorrection(
      entry.T_cam_anchor, {next.T_cam_anchor, T_next_anchor}, std::min(progress, 1.0));
}

}  // namespace dsorb::io
