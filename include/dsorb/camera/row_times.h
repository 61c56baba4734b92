// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/calibration.h"
#include "dsorb/camera/pinhole_camera.h"

#include <array>

namespace dsorb {

/// When each pixel of a rectified image was exposed, relative to the middle row of the sensor. The
/// sensor's rows are curves after rectification; a polynomial of third order in the pixel follows
/// them.
struct RowTimes {
  Readout readout{};  ///< time from the first to the last row (or column)
  /// Share of the readout, from -1/2 to 1/2: factors of 1, x, y, xx, xy, yy, xxx, xxy, xyy, yyy, x
  /// and y from -1 to 1 between the outermost pixel centres.
  std::array<double, 10> share{};
  int width = 0;   ///< width of the rectified images [px]
  int height = 0;  ///< height of the rectified images [px]

  /// @param x, y pixel of level 0
  /// @return relative to the middle row, by Readout::seconds [s]
  [[nodiscard]] double at(double x, double y) const;
};

/// Row times of images that are rectified for a camera.
/// @param lens      with `readout`, or `columns` at least, and the size of the raw images
/// @param camera    that images are rectified for
/// @param resampled false: rectification leaves pixels where they are (RectificationMode::kNone)
[[nodiscard]] RowTimes rowTimes(const Lens& lens, const PinholeCamera& camera, bool resampled);

}  // namespace dsorb
