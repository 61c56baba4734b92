// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/frame.h"
#include "dsorb/image/frame_priors.h"

namespace dsorb {

/// Whether a depth of a prior is known.
bool isKnownDepth(float depth);

/// @throws std::invalid_argument unless there is a depth and a sigma for every pixel
void checkSize(const DepthPrior& prior);

/// @throws std::invalid_argument on priors that cannot belong to the frame; the message says which
void checkPriors(const Frame& frame);

}  // namespace dsorb
