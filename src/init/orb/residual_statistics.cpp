// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/residual_statistics.h"

#include "base/median.h"

#include <cmath>
#include <utility>

namespace dsorb::init_orb {
namespace {

constexpr double kConverged = 1e-3;  // relative change of the squared scale
constexpr int kMaxIterations = 50;   // measured: 8 to 12 are needed

}  // namespace

double tWeight(double residual, double scale) {
  const double ratio = residual / scale;
  return (kTDegrees + 1) / (kTDegrees + ratio * ratio);
}

TDistribution fitTDistribution(const std::vector<double>& residuals, double prefilter) {
  TDistribution fit;
  const double median = medianOf(residuals);
  std::vector<double> magnitudes;
  magnitudes.reserve(residuals.size());
  for (const double residual : residuals) magnitudes.push_back(std::abs(residual - median));
  const double spread = kMadToSigma * medianOf(std::move(magnitudes));
  std::vector<double> squares;
  squares.reserve(residuals.size());
  for (const double residual : residuals) {
    if (std::abs(residual - median) < prefilter * spread) squares.push_back(residual * residual);
  }
  fit.samples = static_cast<int>(squares.size());
  double variance = spread * spread;
  while (!squares.empty() && fit.iterations < kMaxIterations) {
    ++fit.iterations;
    double sum = 0;
    for (const double square : squares) {
      sum += (kTDegrees + 1) / (kTDegrees + square / variance) * square;
    }
    const double next = sum / static_cast<double>(squares.size());
    const bool converged = std::abs(next - variance) <= kConverged * variance;
    variance = next;
    if (converged) break;
  }
  fit.scale = std::sqrt(variance);
  return fit;
}

}  // namespace dsorb::init_orb
