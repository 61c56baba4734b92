// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/map/depth_lookup.h"

#include "image/frame_priors.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace dsorb::init_orb {
namespace {

constexpr int kRadius = 4;           // of a pixel without depth [px]
constexpr double kGuessSigma = 0.1;  // least relative standard deviation there [-]

/// Weighted sums over known pixels.
struct Sums {
  double weight = 0;
  double mean = 0;
  double square = 0;
  double claimed = 0;  // variances

  void add(double inverse_depth, double variance, double w) {
    weight += w;
    mean += w * inverse_depth;
    square += w * inverse_depth * inverse_depth;
    claimed += w * variance;
  }
  [[nodiscard]] double average() const { return mean / weight; }
  [[nodiscard]] double spread() const {
    return std::max(0.0, square / weight - average() * average());
  }
};

Sums sumAround(const DepthPrior& prior, int x, int y, int radius) {
  Sums sums;
  for (int v = std::max(0, y - radius); v <= std::min(prior.height - 1, y + radius); ++v) {
    for (int u = std::max(0, x - radius); u <= std::min(prior.width - 1, x + radius); ++u) {
      const auto i = static_cast<std::size_t>(v) * static_cast<std::size_t>(prior.width) +
                     static_cast<std::size_t>(u);
      if (!isKnownDepth(prior.depth[i])) continue;
      const auto depth = static_cast<double>(prior.depth[i]);
      const double sigma = static_cast<double>(prior.sigma[i]) / (depth * depth);
      sums.add(1 / depth, sigma * sigma, 1 / (1 + std::hypot(u - x, v - y)));
    }
  }
  return sums;
}

}  // namespace

KnownInverseDepth DepthLookup::at(const Eigen::Vector2f& pixel) const {
  const auto x = static_cast<int>(std::lround(pixel.x()));
  const auto y = static_cast<int>(std::lround(pixel.y()));
  const Sums own = sumAround(prior_, x, y, 0);
  const Sums around = sumAround(prior_, x, y, own.weight > 0 ? 1 : kRadius);
  if (!(around.weight > 0)) return {};
  const Sums& best = own.weight > 0 ? own : around;
  double variance = inflation_ * inflation_ * best.claimed / best.weight + around.spread();
  if (!(own.weight > 0)) {
    const double guess = kGuessSigma * best.average();
    variance += guess * guess;
  }
  return {metres_ * best.average(), metres_ * metres_ * variance};
}

}  // namespace dsorb::init_orb
