// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/result.h"

#include <vector>

namespace dsorb {

/// Changes the unit of length so that an inverse depth `mean` becomes 1. It is done here only.
void changeUnit(double mean, std::vector<PosedFrame>& frames);
template <typename Scalar>
void changeUnit(double mean, Scalar& inverse_depth, Scalar& variance) {
  inverse_depth = static_cast<Scalar>(inverse_depth / mean);
  variance = static_cast<Scalar>(variance / (mean * mean));
}

/// Changes the unit of length so that the mean inverse depth of the reference's points is 1:
/// translations, inverse depths, variances and covariances alike. Used by every initializer.
/// @throws std::logic_error when that mean is not positive
void normalizeScale(InitializationResult& result);

}  // namespace dsorb
