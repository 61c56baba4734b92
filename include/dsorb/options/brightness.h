// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/cxx17.h"

namespace dsorb {

/// What is known of the images' brightness, and with it what is free in a frame's gain and offset.
enum class BrightnessModel {
  kUncalibrated,  ///< raw grey levels: both free, bounded relative to the reference
  kCalibrated,    ///< response and vignette known: both free, with priors and absolute bounds
  kPerfect        ///< rendered images: both fixed
};

}  // namespace dsorb
