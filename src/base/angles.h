// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>

namespace dsorb {

constexpr double kDegPerRad = 180 / M_PI;
constexpr double kRadPerDeg = M_PI / 180;

}  // namespace dsorb
