// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "init/orb/map/attempt_types.h"

namespace dsorb::init_orb {

/// Photometric adjustment, outlier filter and second adjustment of the attempt's map, as the
/// options want them. @return false when the attempt fails; its reason says why
bool adjustImages(const AttemptContext& context, Attempt& attempt);

}  // namespace dsorb::init_orb
