// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/cxx17.h"

namespace dsorb::published {

/// Makes the published variants known to `makeInitializer`, `Odometry`, configuration files and the
/// command line by their names `orb-v1`, `orb-v2`, `orb-v3` and `orb-matching`, for as long as the
/// process lives. Further calls do nothing; several threads may call it.
/// @throws std::invalid_argument where another library has taken one of the names
void registerInitializers();

}  // namespace dsorb::published
