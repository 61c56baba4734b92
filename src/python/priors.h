// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/frame_priors.h"

#include <memory>

namespace dsorb::python {

/// What a caller knows of one frame.
struct Priors {
  FramePriors priors;
};

/// A copy that a frame may share; null where there is none.
inline std::shared_ptr<const FramePriors> sharedPriors(const Priors* priors) {
  return priors == nullptr ? nullptr : std::make_shared<const FramePriors>(priors->priors);
}

}  // namespace dsorb::python
