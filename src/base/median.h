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

/// The value that a share of the others, below 1, does not exceed; 0 when there are none.
/// @param values are reordered
template <typename Value>
Value quantileInPlace(std::vector<Value>& values, double share) {
  if (values.empty()) return 0;
  const auto at =
      values.begin() + static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size()));
  std::nth_element(values.begin(), at, values.end());
  return *at;
}

/// Median, the upper one of the middle values when their number is even; 0 when there are none.
/// @param values are reordered
template <typename Value>
Value medianInPlace(std::vector<Value>& values) {
  return quantileInPlace(values, 0.5);
}

/// The same, leaving the caller's values as they are.
inline double medianOf(std::vector<double> values) {
  return medianInPlace(values);
}

}  // namespace dsorb
