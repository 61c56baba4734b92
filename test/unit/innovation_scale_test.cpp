// SPDX-License-Identifier: BSD-3-Clause
#include "base/random.h"
#include "odometry/mapper.h"

#include <gtest/gtest.h>

#include <cmath>

namespace dsorb::odometry {
namespace {

/// Root of the mean squared quotient of error and widened sigma over many runs, whose estimate is
/// the mean of five more values at each adjustment. They scatter by `scatter` where their sigma
/// says 1, and the five of an adjustment have an error in common with standard deviation `shared`.
double quotientOfMeans(double scatter, double shared) {
  constexpr int kRuns = 400, kAdjustments = 12, kValues = 5;
  Random random(11);
  double squares = 0;
  for (int run = 0; run < kRuns; ++run) {
    InnovationScale innovations;
    double sum = 0, widened = 0;
    for (int i = 1; i <= kAdjustments; ++i) {
      const double common = shared * random.gaussian();
      for (int k = 0; k < kValues; ++k) sum += scatter * random.gaussian() + common;
      const double sigma = 1 / std::sqrt(kValues * i);
      widened = sigma * innovations.update(sum / (kValues * i), sigma);
    }
    const double error = sum / (kValues * kAdjustments);
    squares += error * error / (widened * widened);
  }
  return std::sqrt(squares / kRuns);
}

// Measured: 1.00.
TEST(InnovationScale, LeavesAnEstimateThatIsAsSureAsItSays) {
  EXPECT_NEAR(quotientOfMeans(1, 0), 1, 0.1);
}

// Measured: 1.18 and 1.24; 3 and 2.4 if nothing were widened.
TEST(InnovationScale, WidensOneThatMovesByMore) {
  EXPECT_LT(quotientOfMeans(3, 0), 1.5);
  EXPECT_LT(quotientOfMeans(1, 1), 1.5);
}

}  // namespace
}  // namespace dsorb::odometry
