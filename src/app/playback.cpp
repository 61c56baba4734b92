// SPDX-License-Identifier: BSD-3-Clause
#include "app/playback.h"

#include "io/input/image_source.h"

#include <cmath>
#include <cstddef>
#include <utility>

namespace dsorb::app {

Playback::Playback(std::vector<double> timestamps, double speed) : due_(std::move(timestamps)) {
  double due = 0;
  double previous = due_.empty() ? 0 : due_.front();
  for (double& time : due_) {
    if (speed > 0) due += std::abs(time - previous) / speed;
    previous = time;
    time = due;
  }
}

Playback::Step Playback::next(double now) {
  Step step;
  if (position_ == due_.size()) return step;
  if (!begin_) begin_ = now;
  const double elapsed = now - *begin_;
  if (elapsed < due_[position_]) {
    step.wait = due_[position_] - elapsed;
    return step;
  }
  for (std::size_t next = position_ + kCameraBuffers;
       next < due_.size() && due_[next] > due_[position_] && due_[next] <= elapsed;
       ++next) {
    ++position_;
    ++step.drop;
  }
  ++position_;
  step.late = position_ < due_.size() && due_[position_] <= elapsed &&
              due_[position_] > due_[position_ - 1];
  dropped_ += step.drop;
  return step;
}

}  // namespace dsorb::app
