// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/calibration.h"
#include "dsorb/error.h"

#include <functional>
#include <string>
#include <string_view>
#include <vector>

namespace dsorb {

constexpr double kMaxSize = 65536;  ///< of an image [px] a side

/// Makes the error of a file from what is wrong.
using Complain = std::function<IoError(const std::string& what)>;

/// @throws what `complain` makes where they are no whole numbers from 1 to 65536
void setSize(double width, double height, Lens& lens, const Complain& complain);

/// Coefficients in the order of OpenCV for the lens' model; those missing are 0.
/// @throws what `complain` makes where the model has no place for one that is not 0: OpenCV's
///         rational model, thin prisms, tilted sensors
void setCoefficients(const std::vector<double>& coefficients, Lens& lens, const Complain& complain);

inline constexpr const char* kReadoutKey = "readout_ms";  ///< of YAML and XML
/// What setReadout() reads.
inline constexpr const char* kReadoutForm =
    "milliseconds from the first to the last row, -1000 to 1000, or auto, and perhaps 'columns'";

/// The readout as calibrations write it: parseReadout(), and perhaps "columns" behind it.
/// @return false where the text is another
[[nodiscard]] bool setReadout(std::string_view text, Lens& lens);

/// @throws what `complain` makes on a focal length that is not positive, an omega out of range, or
///         a principal point outside the image, where its size is known
void checkLens(const Lens& lens, const Complain& complain);

}  // namespace dsorb
