// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/result.h"

namespace dsorb {

/// Changes the unit of length so that the mean inverse depth of the reference's points is 1:
/// translations, inverse depths, variances and covariances alike. Used by every initializer.
/// @throws std::logic_error when that mean is not positive
void normalizeScale(InitializationResult& result);

}  // namespace dsorb
