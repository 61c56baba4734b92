// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/frame.h"

namespace dsorb {

/// Whether a frame shows next to nothing beside another one of its camera: black, covered,
/// overexposed or full of noise alone. A shorter exposure excuses it.
[[nodiscard]] bool isBlank(const Frame& frame, const Frame& beside);

}  // namespace dsorb
