// SPDX-License-Identifier: BSD-3-Clause
#include "odometry/probation.h"

#include <limits>
#include <utility>

namespace dsorb::odometry {
namespace {

constexpr std::size_t kMaxFrames = 60;  // kept to be used again; older ones are forgotten

}  // namespace

void Probation::begin(const InitializationResult& result) {
  frames_.clear();
  keyframes_ = 1;
  for (const PosedFrame& posed : result.frames) add(posed.frame);
}

void Probation::add(const FramePtr& frame) {
  frames_.push_back(frame);
  if (frames_.size() > kMaxFrames) frames_.pop_front();
}

bool Probation::passes(double rms) {
  ++keyframes_;
  double limit = std::numeric_limits<double>::infinity();
  if (keyframes_ <= 2) {
    limit = options_.max_rms_second;
  } else if (keyframes_ == 3) {
    limit = options_.max_rms_third;
  } else if (keyframes_ == 4) {
    limit = options_.max_rms_fourth;
  }
  judgement_ = {};
  judgement_.keyframes = keyframes_;
  judgement_.rms = rms;
  judgement_.limit = limit;
  if (!(rms <= limit)) return false;
  if (keyframes_ >= 4) frames_.clear();
  return true;
}

std::deque<FramePtr> Probation::end() {
  std::deque<FramePtr> frames = std::exchange(frames_, {});
  if (!frames.empty()) frames.pop_front();
  return frames;
}

}  // namespace dsorb::odometry
