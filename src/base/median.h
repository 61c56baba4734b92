// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstddef>
#include <vector>

namespace dsorb {

/// Standard deviation of a normal distribution over the median of its absolute deviations.
constexpr double kMadToSigma = 1.4826;

/// Median length of a two-dimensional vector whose coordinates have standard deviation 1.
constexpr double kMedianLength = 1.1774;

/// Median, the upper one of the middle values when their number is even; 0 when there are none.
/// @param values are reordered
template <typename Value>
Value medianInPlace(std::vector<Value>& values) {
  if (values.empty()) return 0;
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// The same, leaving the caller's values as they are.
inline double medianOf(std::vector<double> values) {
  return medianInPlace(values);
}

}  // namespace dsorb
