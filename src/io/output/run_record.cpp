// SPDX-License-Identifier: BSD-3-Clause
#include "io/output/run_record.h"

#include "dsorb/init/metric_scale.h"

#include "geometry/reattachment.h"
#include "io/output/output_file.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace dsorb::io {

int RunRecord::longestSegment() const {
  std::map<int, int> frames;
  for (const PosedEntry& entry : frames_) ++frames[segmentOf(entry)];
  const auto longest = std::max_element(
      frames.begin(), frames.end(), [](auto& a, auto& b) { return a.second < b.second; });
  return longest == frames.end() ? -1 : longest->first;
}

void RunRecord::addInitStep(const InitStep& step, int segment) {
  steps_.push_back({step.status, step.reason, segment, step.result, {}});
  ++facts_.answers[step.reason];
}

void RunRecord::addInitialization(InitializationResult result, int segment) {
  facts_.segments.try_emplace(segment, result.metric);
  if (result.metric) toMetres(*result.metric, result);
  noteReadout(result);
  noteStuck(result);
  const FrameId reference = result.frames.front().frame->id();
  const double begin = result.frames.front().frame->timestamp();
  const double duration = result.frames.back().frame->timestamp() - begin;
  anchors_.try_emplace(reference, SE3(), begin);
  starts_.push_back({result.frames.back().frame->id(), *result.frames.back().T_cam_ref});
  const int start = static_cast<int>(starts_.size()) - 1;
  // Frames up to the newest one that has a line were posed when they were recognized.
  const auto recognized =
      std::find_if(result.frames.rbegin(), result.frames.rend(), [this](const PosedFrame& posed) {
        return !frames_.empty() && posed.frame->id() == frames_.back().id;
      });
  for (auto frame = recognized.base(); frame != result.frames.end(); ++frame) {
    const PosedFrame& posed = *frame;
    if (!posed.T_cam_ref || !isFinite(*posed.T_cam_ref)) continue;
    const double time = posed.frame->timestamp();
    const PosedEntry entry{posed.frame->id(),
                           time,
                           segment,
                           reference,
                           *posed.T_cam_ref,
                           start,
                           (time - begin) / duration};
    frames_.push_back(entry);
    for (const Repeat& repeat : repeats_) {
      if (repeat.of != posed.frame->id()) continue;
      frames_.push_back(entry);
      frames_.back().id = repeat.id;
      frames_.back().timestamp = repeat.timestamp;
    }
  }
  repeats_.clear();
}

void RunRecord::noteReadout(const InitializationResult& result) {
  constexpr double kSuspicious = 3;  // standard deviations
  constexpr double kLongest = 0.1;   // that a shutter takes [s]
  const auto milliseconds = result.report.detail("readout_score_ms");
  const auto sigma = result.report.detail("readout_score_sigma_ms");
  if (!milliseconds || !sigma) return;
  const Readout score{*milliseconds / 1000, *sigma / 1000};
  const double interval =
      result.frames[1].frame->timestamp() - result.frames.front().frame->timestamp();
  if (std::abs(score.seconds) > std::min(std::abs(interval), kLongest)) return;
  const Readout known = facts_.suspected_readout.value_or(Readout{kSuspicious, 1});
  if (std::abs(score.seconds) * known.sigma > std::abs(known.seconds) * score.sigma) {
    facts_.suspected_readout = score;
  }
}

void RunRecord::noteStuck(const InitializationResult& result) {
  const double stuck = result.report.detail("stuck_tracks").value_or(0);
  if (stuck > 0) {
    facts_.stuck_share =
        std::max(facts_.stuck_share, stuck / (stuck + *result.report.detail("tracks")));
  }
}

void RunRecord::addRefusal(const StartRefusal& refusal) {
  ++facts_.refusals[refusal.reason];
  steps_.back().refusal = refusal;
}

std::optional<MetricScale> RunRecord::unitOf(int segment) const {
  const auto found = facts_.segments.find(segment);
  return found == facts_.segments.end() ? std::nullopt : found->second;
}

void RunRecord::addFrame(const FrameEstimate& estimate) {
  estimate_ = estimate;
  ++facts_.frames_given;
  facts_.last_state = estimate.state;
  if (estimate.repeats && !estimate.T_world_cam) {
    repeats_.push_back({estimate.frame->id(), estimate.frame->timestamp(), *estimate.repeats});
  }
  facts_.frames_tracked += estimate.state == OdometryState::kTracked ? 1 : 0;
  facts_.frames_missed += estimate.state == OdometryState::kMissed ? 1 : 0;
  if (estimate.state == OdometryState::kInitialized && !steps_.empty() && steps_.back().result) {
    addInitialization(*steps_.back().result, estimate.segment);
  }
  const bool placed =
      estimate.state == OdometryState::kTracked || estimate.state == OdometryState::kInitialized;
  if (!placed || !estimate.T_world_cam || !isFinite(*estimate.T_world_cam)) return;

  PosedEntry entry{
      estimate.frame->id(), estimate.frame->timestamp(), estimate.segment, FrameId{}, SE3(), -1, 0};
  if (estimate.keyframe && estimate.T_cam_keyframe && isFinite(*estimate.T_cam_keyframe)) {
    entry.anchor = *estimate.keyframe;
    entry.T_cam_anchor = *estimate.T_cam_keyframe;
    const SE3 T_world_anchor = *estimate.T_world_cam * entry.T_cam_anchor;
    Anchor& anchor = anchors_.try_emplace(entry.anchor, T_world_anchor).first->second;
    if (estimate.is_keyframe && entry.anchor != entry.id) {
      anchor.next = entry.id;
      anchor.T_next_cam = entry.T_cam_anchor;
    }
  } else {  // a keyframe is its own anchor
    entry.anchor = entry.id;
    anchors_.try_emplace(entry.id, *estimate.T_world_cam, entry.timestamp);
  }
  if (!frames_.empty() && frames_.back().id == entry.id) {  // came with a result
    frames_.back() = entry;
  } else {
    frames_.push_back(entry);
  }
}

void RunRecord::noteCamera(const KeyframeSnapshot& keyframe) {
  if (!keyframe.camera_score || !keyframe.camera_score->suspicious()) return;
  const CameraScore known = facts_.contradicted_camera.value_or(CameraScore());
  if (keyframe.camera_score->deviations() > known.deviations()) {
    facts_.contradicted_camera = keyframe.camera_score;
  }
}

void RunRecord::addKeyframe(const KeyframeSnapshot& keyframe) {
  noteCamera(keyframe);
  if (!isFinite(keyframe.T_world_cam)) return;
  Anchor& anchor = anchors_[keyframe.id];
  anchor.T_world_cam = keyframe.T_world_cam;
  anchor.timestamp = keyframe.timestamp;
  if (anchor.is_keyframe) return;
  anchor.is_keyframe = true;
  keyframes_.push_back(
      {keyframe.id, keyframe.timestamp, keyframe.segment, keyframe.id, SE3(), -1, 0});
}

void RunRecord::nextFrame() {
  steps_.clear();
  estimate_.reset();
}

void RunRecord::addJoin(const SegmentsJoined& joined) {
  changes_.add(joined);
  auto segment = facts_.segments.extract(joined.segment);
  if (segment.empty()) return;
  segment.key() = joined.into;  // which may be that of a map of before
  facts_.segments.insert(std::move(segment));
}

SE3 RunRecord::T_world_cam(const PosedEntry& entry) const {
  SE3 told = toldPose(entry);
  if (changes_.empty()) return told;
  const bool is_own = anchors_.count(entry.id) > 0;
  SE3 pose = changes_.changeOf(entry.segment, is_own ? entry.id : entry.anchor).moved(told);
  if (is_own || changes_.moved.empty() || entry.start >= 0) return pose;
  // Between two keyframes the change by loops goes over from one to the other.
  const auto [next, progress] = nextOf(entry);
  if (next == nullptr) return pose;
  const SE3 by_next = changes_.changeOf(entry.segment, *anchors_.at(entry.anchor).next).moved(told);
  const Vector6d way = (by_next * pose.inverse()).log();
  return SE3::exp(std::clamp(progress, 0.0, 1.0) * way) * pose;
}

/// The keyframe after that of an entry, null where there is none, and how far the entry is on the
/// way to it: frames tracked while the next keyframe is made lie behind it.
std::pair<const RunRecord::Anchor*, double> RunRecord::nextOf(const PosedEntry& entry) const {
  const Anchor& anchor = anchors_.at(entry.anchor);
  const auto next = anchor.next ? anchors_.find(*anchor.next) : anchors_.end();
  if (next == anchors_.end() || !anchor.timestamp || !next->second.timestamp) return {nullptr, 0};
  return {&next->second,
          (entry.timestamp - *anchor.timestamp) / (*next->second.timestamp - *anchor.timestamp)};
}

SE3 RunRecord::toldPose(const PosedEntry& entry) const {
  const auto own = anchors_.find(entry.id);  // the frame became a keyframe itself
  if (own != anchors_.end()) return own->second.T_world_cam;
  const Anchor& anchor = anchors_.at(entry.anchor);
  const auto T_end_anchor = [&](const Anchor& end) {
    return end.T_world_cam.inverse() * anchor.T_world_cam;
  };
  SE3 T_cam_anchor = entry.T_cam_anchor;
  if (entry.start >= 0) {
    const Start& start = starts_[static_cast<std::size_t>(entry.start)];
    const auto newest = anchors_.find(start.newest);
    if (newest != anchors_.end()) {
      T_cam_anchor = reattach(
          T_cam_anchor, {start.T_newest_reference, T_end_anchor(newest->second)}, entry.progress);
    }
  } else if (const auto [next, progress] = nextOf(entry); next != nullptr) {
    T_cam_anchor = spreadCorrection(
        T_cam_anchor, {anchor.T_next_cam, T_end_anchor(*next)}, std::min(progress, 1.0));
  }
  return anchor.T_world_cam * T_cam_anchor.inverse();
}

}  // namespace dsorb::io
