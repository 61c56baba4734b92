// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/image/frame.h"

#include <optional>
#include <vector>

namespace dsorb {

/// Refuses frames that cannot belong to one sequence of one camera.
class FrameCheck {
 public:
  /// @throws std::invalid_argument a camera without size, focal length or principal point, or of a
  ///         size whose odd sides leave fewer pyramid levels than it has pixels for
  explicit FrameCheck(const PinholeCamera& camera);

  /// Accepts the frame as the next one.
  /// @throws std::invalid_argument no frame, wrong size, id of an earlier frame, exposure not
  ///         positive, timestamp not finite, equal to the previous one or a change of direction,
  ///         row times where those before have none or the other way round, priors that do not fit;
  ///         the message names both values, nothing is changed
  void accept(const FramePtr& frame);
  /// The next frame is taken as the first one.
  void restart();

 private:
  int width_;
  int height_;
  std::vector<int> ids_;             // of all frames, sorted
  std::optional<bool> has_rows_;     // whether frames have row times
  std::optional<double> timestamp_;  // of the previous frame [s]
  std::optional<bool> is_forward_;   // direction of time, known from the second frame on
};

}  // namespace dsorb
