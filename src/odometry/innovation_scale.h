// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cmath>

namespace dsorb::odometry {

/// How much less sure an estimate is than the variances of its adjustments say. While it gathers
/// information it should move, from one adjustment to the next, with the difference of its
/// variances; where models do not hold it moves by more.
/// @source Bar-Shalom, Li, Kirubarajan, Estimation with Applications to Tracking and Navigation,
///         section 5.4: normalised innovation squared
class InnovationScale {
 public:
  /// @param sigma as its adjustment says
  /// @return factor on sigma, at least 1
  double update(double value, double sigma) {
    if (sigma_ > 0) {
      const double variance = sigma_ * sigma_;
      const double gained = std::max(variance - sigma * sigma, kLeastGain * variance);
      squares_ += (value - value_) * (value - value_) / gained;
      ++count_;
    }
    value_ = value;
    sigma_ = sigma;
    return std::sqrt(std::max(1.0, (1 + squares_) / (1 + count_)));
  }

 private:
  static constexpr double kLeastGain = 0.05;  // of a variance: less is rounding

  double value_ = 0;
  double sigma_ = 0;
  double squares_ = 0;
  int count_ = 0;
};

}  // namespace dsorb::odometry
