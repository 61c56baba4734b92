// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/c/dsorb.h"
#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/camera/row_times.h"
#include "dsorb/image/frame.h"
#include "dsorb/init/initializer.h"
#include "dsorb/odometry/odometry.h"

#include <memory>
#include <stdexcept>
#include <string>

namespace dsorb::c {

template <typename Pointer>
void require(Pointer pointer, const char* name) {
  if (pointer == nullptr) throw std::invalid_argument(std::string(name) + " is NULL");
}

/// Camera of all images of an object.
struct ImageSource {
  PinholeCamera camera;
  std::shared_ptr<const RowTimes> row_times;  ///< nullptr: a global shutter
};

/// @throws std::invalid_argument
[[nodiscard]] ImageSource sourceOf(const dsorb_camera* camera);
/// @throws std::invalid_argument
[[nodiscard]] FramePtr frameOf(const dsorb_image* image, const ImageSource& source);

[[nodiscard]] dsorb_frame frameOfStart(const PosedFrame& posed);
[[nodiscard]] dsorb_estimate estimateOf(const FrameEstimate& made);

}  // namespace dsorb::c
