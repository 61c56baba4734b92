// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <vector>

namespace dsorb::init_orb {

/// Degrees of freedom of the residuals' t-distribution.
/// @source [Gladkova], section 3.4, after Kerl, Sturm, Cremers, ICRA 2013
constexpr double kTDegrees = 5;

/// Spread of residuals around zero, as a t-distribution of kTDegrees.
struct TDistribution {
  double scale = 0;  ///< sigma of the distribution, not its standard deviation
  int samples = 0;   ///< that passed the prefilter
  int iterations = 0;
};

/// Scale of greatest likelihood. Residuals farther from the median than `prefilter` times 1.4826
/// MAD have no part: the fit breaks down at one sixth of outliers.
/// @param prefilter [1.4826 MAD]
/// @source [Gladkova], eq. (14): sigma^2 = mean of w r^2, w = (nu + 1) / (nu + (r / sigma)^2)
TDistribution fitTDistribution(std::vector<float> residuals, double prefilter);

/// Sum of the weights of some residuals under the distribution; the weight of a zero is 1.2.
float sumOfTWeights(const float* residuals, std::size_t count, float scale);

}  // namespace dsorb::init_orb
