// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/frame.h"

namespace dsorb {

/// Whether a depth of a prior is known.
bool isKnownDepth(float depth);

/// @throws std::invalid_argument on priors that cannot belong to the frame; the message says which
void checkPriors(const Frame& frame);

}  // namespace dsorb
