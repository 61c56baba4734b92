// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/rectifier.h"
#include "dsorb/image/frame.h"
#include "dsorb/image/frame_priors.h"

#include <memory>
#include <optional>
#include <utility>

namespace dsorb::python {

/// Camera of rectified images, and what all their frames share.
class FrameSource {
 public:
  /// A global shutter and a linear response.
  explicit FrameSource(const PinholeCamera& camera) : camera_(camera) {}
  /// That makes the images.
  explicit FrameSource(const Rectifier& rectifier)
      : camera_(rectifier.camera()),
        response_slope_(rectifier.responseSlope()),
        row_times_(rectifier.rowTimes()) {}

  [[nodiscard]] const PinholeCamera& camera() const { return camera_; }
  /// @param id none: the one after the last frame's
  [[nodiscard]] FrameInfo next(double timestamp,
                               std::optional<int> id,
                               double exposure,
                               std::shared_ptr<const FramePriors> priors) const {
    return {FrameId{id.value_or(next_id_)},
            timestamp,
            exposure,
            response_slope_,
            row_times_,
            std::move(priors)};
  }
  void taken(FrameId frame) { next_id_ = frame.value + 1; }

 private:
  PinholeCamera camera_;
  std::shared_ptr<const ResponseSlope> response_slope_;
  std::shared_ptr<const RowTimes> row_times_;
  int next_id_ = 0;
};

}  // namespace dsorb::python
