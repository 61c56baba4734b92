// SPDX-License-Identifier: BSD-3-Clause
#include "odometry/probation.h"

#include <algorithm>
#include <utility>

namespace dsorb::odometry {
namespace {

// Keyframes since the start.
constexpr int kOfTheStart = 2;
constexpr int kLastJudged = 4;

/// @param keyframes since the start, at most kLastJudged
double limitOf(int keyframes, const ProbationOptions& options) {
  if (keyframes <= 2) return options.max_rms_second;
  return keyframes == 3 ? options.max_rms_third : options.max_rms_fourth;
}

}  // namespace

void Probation::begin(const InitializationResult& result) {
  frames_.clear();
  judgement_ = {};
  for (const PosedFrame& posed : result.frames) keep(posed.frame);
}

void Probation::add(const FramePtr& frame) {
  if (active()) keep(frame);
}

void Probation::keep(const FramePtr& frame) {
  frames_.push_back(frame);
  if (frames_.size() > kMaxFrames) frames_.pop_front();
}

bool Probation::passes(double rms) {
  if (!active()) return true;
  const int keyframes = std::max(judgement_.keyframes + 1, kOfTheStart);
  judgement_ = {keyframes, rms, limitOf(keyframes, options_)};
  if (!(rms <= judgement_.limit)) return false;
  if (keyframes >= kLastJudged) frames_.clear();
  return true;
}

std::deque<FramePtr> Probation::end() {
  std::deque<FramePtr> frames = std::exchange(frames_, {});
  if (!frames.empty()) frames.pop_front();
  return frames;
}

}  // namespace dsorb::odometry
