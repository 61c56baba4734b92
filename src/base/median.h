// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace dsorb {

/// Standard deviation of a normal distribution over the median of its absolute deviations.
constexpr double kMadToSigma = 1.4826;

/// The upper one of an even number of values; 0 without values. @param values get another order
template <typename Value>
Value medianInPlace(std::vector<Value>& values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// The same without touching the caller's values.
inline double medianOf(std::vector<double> values) {
  return medianInPlace(values);
}

}  // namespace dsorb
