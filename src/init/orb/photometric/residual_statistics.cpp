// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/photometric/residual_statistics.h"

#include "base/lanes.h"
#include "base/median.h"
#include "base/target_clones.h"

#include <algorithm>
#include <cmath>

namespace dsorb::init_orb {
namespace {

constexpr double kConverged = 1e-3;  // relative change of the squared scale
constexpr int kMaxIterations = 50;   // measured: 8 to 12 are needed
constexpr std::size_t kBlock = 256;  // terms summed in single precision before doubles take over
constexpr double kMinScale = 0.29;   // error of rounding, 1 / sqrt(12) [grey levels]

/// Sum of w r^2 over a block. @param squares r^2, a multiple of the lanes; zeros add nothing
DSORB_TARGET_CLONES float weightedSquares(const float* squares, std::size_t count, float variance) {
  Lanes sum = {};
  for (std::size_t i = 0; i < count; i += kLanes) {
    Lanes square;
    load(squares + i, square);
    sum += square / (static_cast<float>(kTDegrees) * variance + square);
  }
  return static_cast<float>(kTDegrees + 1) * variance * sumLanes(sum);
}

/// Root of the mean square of what is left of the residuals without the median.
double rootMeanSquare(const std::vector<float>& magnitudes) {
  double sum = 0;
  for (const float magnitude : magnitudes) sum += static_cast<double>(magnitude * magnitude);
  return std::sqrt(sum / static_cast<double>(std::max<std::size_t>(magnitudes.size(), 1)));
}

/// Squares of the residuals that pass the prefilter, filled up with zeros to whole lanes.
std::vector<float> filteredSquares(const std::vector<float>& residuals,
                                   float median,
                                   float limit,
                                   int& samples) {
  std::vector<float> squares(residuals.size() + kLanes);
  std::size_t kept = 0;
  for (const float residual : residuals) {
    squares[kept] = residual * residual;
    kept += std::abs(residual - median) < limit ? 1 : 0;
  }
  samples = static_cast<int>(kept);
  const std::size_t lanes = kLanes;
  const std::size_t padded = (kept + lanes - 1) / lanes * lanes;
  squares.resize(kept);
  squares.resize(padded, 0);
  return squares;
}

}  // namespace

float sumOfTWeights(const float* residuals, std::size_t count, float scale) {
  const float inverse = 1 / (scale * scale);
  float sum = 0;
  for (std::size_t i = 0; i < count; ++i) {
    sum += static_cast<float>(kTDegrees + 1) /
           (static_cast<float>(kTDegrees) + residuals[i] * residuals[i] * inverse);
  }
  return sum;
}

TDistribution fitTDistribution(std::vector<float> residuals, double prefilter) {
  TDistribution fit;
  const float median = medianInPlace(residuals);
  std::vector<float> magnitudes(residuals.size());
  for (std::size_t i = 0; i < residuals.size(); ++i) {
    magnitudes[i] = std::abs(residuals[i] - median);
  }
  double spread = kMadToSigma * static_cast<double>(medianInPlace(magnitudes));
  // More than half of the residuals are the same: a still overlay, strongly quantized images.
  const bool degenerate = !residuals.empty() && !(spread > 0);
  if (degenerate) spread = std::max(rootMeanSquare(magnitudes), kMinScale);
  const std::vector<float> squares =
      filteredSquares(residuals, median, static_cast<float>(prefilter * spread), fit.samples);
  double variance = spread * spread;
  while (fit.samples > 0 && variance > 0 && fit.iterations < kMaxIterations) {
    ++fit.iterations;
    double sum = 0;
    for (std::size_t i = 0; i < squares.size(); i += kBlock) {
      sum += static_cast<double>(weightedSquares(
          squares.data() + i, std::min(kBlock, squares.size() - i), static_cast<float>(variance)));
    }
    const double next = sum / fit.samples;
    const bool converged = std::abs(next - variance) <= kConverged * variance;
    variance = next;
    if (converged) break;
  }
  fit.scale = degenerate ? std::max(std::sqrt(variance), kMinScale) : std::sqrt(variance);
  return fit;
}

}  // namespace dsorb::init_orb
