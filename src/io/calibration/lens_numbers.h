// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/calibration.h"
#include "dsorb/error.h"

#include "io/calibration/keyed_values.h"

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

/// A parameter of a lens: fx, fy (f: both), cx, cy, or a coefficient as nameOf(model) has them.
/// @throws what `complain` makes where the model has no such coefficient and it is not 0
void setParameter(std::string_view name, double value, Lens& lens, const Complain& complain);

/// Parameters by a list of names; those at its end may be missing.
/// @throws as setParameter()
void setParameters(std::string_view names,
                   const std::vector<double>& values,
                   Lens& lens,
                   const Complain& complain);

/// Coefficients as OpenCV orders them.
inline constexpr const char* kOpenCvOrder = "k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tau_x tau_y";

/// The plainest model of the same lens; images without a distortion are not resampled.
void simplify(Calibration& calibration);

inline constexpr const char* kReadoutKey = "readout_ms";  ///< of YAML and XML
/// What setReadout() reads.
inline constexpr const char* kReadoutForm =
    "milliseconds from the first to the last row, -1000 to 1000, or auto, and perhaps 'columns'";

/// The readout as calibrations write it: parseReadout(), and perhaps "columns" behind it.
/// @return false where the text is another
[[nodiscard]] bool setReadout(std::string_view text, Lens& lens);

/// Reads the key readout_ms, where it is there.
/// @throws IoError naming it
void readReadoutKey(const io::KeyedValues& values, Lens& lens);

/// @throws what `complain` makes on a focal length that is not positive, an omega, xi, alpha or
///         beta out of range, or a principal point outside the image, where its size is known
void checkLens(const Lens& lens, const Complain& complain);

}  // namespace dsorb
