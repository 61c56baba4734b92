// SPDX-License-Identifier: BSD-3-Clause
#include "image/frame_check.h"

#include <cmath>
#include <stdexcept>
#include <string>

namespace dsorb {

void FrameCheck::accept(const FramePtr& frame) {
  if (frame == nullptr) throw std::invalid_argument("frame is null");
  const std::string who = "frame " + std::to_string(frame->id().value) + ": ";
  if (frame->width() != width_ || frame->height() != height_) {
    throw std::invalid_argument(who + "size " + std::to_string(frame->width()) + "x" +
                                std::to_string(frame->height()) + " differs from the camera's " +
                                std::to_string(width_) + "x" + std::to_string(height_));
  }
  const double now = frame->timestamp();
  if (!std::isfinite(now)) throw std::invalid_argument(who + "timestamp is not finite");
  if (timestamp_) {
    const std::string both =
        who + "timestamp " + std::to_string(now) + " after " + std::to_string(*timestamp_);
    if (now == *timestamp_) throw std::invalid_argument(both + ": equal");
    const bool is_forward = now > *timestamp_;
    if (is_forward_.value_or(is_forward) != is_forward) {
      throw std::invalid_argument(both + ": time has changed its direction");
    }
    is_forward_ = is_forward;
  }
  timestamp_ = now;
}

}  // namespace dsorb
