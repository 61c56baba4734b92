// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/rectifier.h"
#include "dsorb/image/frame.h"
#include "dsorb/image/frame_priors.h"

#include <limits>
#include <memory>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

namespace dsorb::python {

/// Calls of several threads wait for each other.
struct LockedRectifier {
  explicit LockedRectifier(const Calibration& calibration) : rectifier(calibration) {}
  std::mutex mutex;
  Rectifier rectifier;
};

/// Camera of rectified images, and what all their frames share.
class FrameSource {
 public:
  /// A global shutter and a linear response.
  explicit FrameSource(const PinholeCamera& camera) : camera_(camera) {}
  /// A rectifier that makes the images.
  explicit FrameSource(const LockedRectifier& locked)
      : camera_(locked.rectifier.camera()),
        response_slope_(locked.rectifier.responseSlope()),
        row_times_(locked.rectifier.rowTimes()) {}

  [[nodiscard]] const PinholeCamera& camera() const { return camera_; }
  /// @param id none: the one after the last frame's
  /// @throws std::invalid_argument below 0
  [[nodiscard]] FrameInfo next(double timestamp,
                               std::optional<int> id,
                               double exposure,
                               std::shared_ptr<const FramePriors> priors) const {
    if (id && *id < 0) {
      throw std::invalid_argument("frame " + std::to_string(*id) + ": expected an id from 0");
    }
    return {FrameId{id.value_or(next_id_)},
            timestamp,
            exposure,
            response_slope_,
            row_times_,
            std::move(priors)};
  }
  /// What `call` makes of that frame. One that it refuses leaves no trace.
  template <typename Call>
  auto given(FrameId frame, const Call& call) {
    try {
      auto made = call();
      taken(frame);
      return made;
    } catch (const std::invalid_argument&) {
      throw;
    } catch (...) {
      taken(frame);
      throw;
    }
  }
  void reset() { next_id_ = 0; }

 private:
  void taken(FrameId frame) {
    next_id_ = frame.value == std::numeric_limits<int>::max() ? 0 : frame.value + 1;
  }

  PinholeCamera camera_;
  std::shared_ptr<const ResponseSlope> response_slope_;
  std::shared_ptr<const RowTimes> row_times_;
  int next_id_ = 0;
};

}  // namespace dsorb::python
