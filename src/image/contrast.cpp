// SPDX-License-Identifier: BSD-3-Clause
#include "image/contrast.h"

#include <algorithm>
#include <cmath>

namespace dsorb {
namespace {

/// Half of the least gain between two images that tracking takes for a change of the light.
constexpr double kBlankShare = 0.1;

/// Standard deviation of the coarsest level, where noise has gone [grey levels].
double contrast(const Frame& frame) {
  const PyramidLevel& level = frame.level(frame.pyramid().levels() - 1);
  double n = 0;
  double sum = 0;
  double squares = 0;
  for (int y = 0; y < level.height(); ++y) {
    for (int x = 0; x < level.width(); ++x) {
      const auto grey = static_cast<double>(level.intensity(x, y));
      if (std::isnan(grey)) continue;
      n += 1;
      sum += grey;
      squares += grey * grey;
    }
  }
  return n > 0 ? std::sqrt(std::max(0.0, squares / n - sum / n * (sum / n))) : 0;
}

}  // namespace

bool isBlank(const Frame& frame, const Frame& beside) {
  const double exposed = std::min(1.0, frame.exposure() / beside.exposure());
  return contrast(frame) < kBlankShare * exposed * contrast(beside);
}

}  // namespace dsorb
