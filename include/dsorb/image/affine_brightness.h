// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/cxx17.h"

#include <cmath>

namespace dsorb {

/// Affine brightness of one frame: log gain a [-] and offset b [grey levels].
/// @source Engel et al., Direct Sparse Odometry, arXiv:1607.02565, eq. (4)
struct AffineBrightness {
  double a = 0;  ///< log gain [-]
  double b = 0;  ///< offset [grey levels]
};

/// I_to = gain * I_from + offset.
struct BrightnessTransfer {
  double gain = 1;    ///< [-]
  double offset = 0;  ///< [grey levels]
};

/// Relative brightness transfer between two frames.
/// @param exposure_from, exposure_to exposure times [s]; when either is not positive both count as
/// 1
/// @return gain g = (t_to e^a_to) / (t_from e^a_from), offset b_to - g b_from
/// @source Engel et al., DSO, eq. (4)
inline BrightnessTransfer brightnessTransfer(const AffineBrightness& from,
                                             double exposure_from,
                                             const AffineBrightness& to,
                                             double exposure_to) {
  const double ratio = exposure_from > 0 && exposure_to > 0 ? exposure_to / exposure_from : 1.0;
  const double gain = ratio * std::exp(to.a - from.a);
  return {gain, to.b - gain * from.b};
}

}  // namespace dsorb
