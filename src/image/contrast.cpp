// SPDX-License-Identifier: BSD-3-Clause
#include "image/contrast.h"

#include "base/median.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <vector>

namespace dsorb {
namespace {

/// Half of the least gain between two images that tracking takes for a change of the light.
constexpr double kBlankShare = 0.1;

// Two images of one moment differ by less than rounding: a moving camera passes it at a hundredth
// of a pixel. The share is that of the standard deviation of the images.
constexpr double kRepeatedShare = 0.005;
constexpr int kRepeatedLevel = 1;  // where it is looked for: a quarter of the pixels

// Standard deviations of the coarsest level of images from seventeen cameras are 17 to 93.
constexpr double kLeastContrast = 16;  // [grey levels]
constexpr double kMostContrast = 150;  // [grey levels]
constexpr double kUsualContrast = 45;  // [grey levels]
constexpr double kUsualNoise = 4;      // as much as thresholds stand, of a pixel [grey levels]
constexpr double kMiddleGrey = 128;    // [grey levels]

struct Moments {
  double mean = 0;
  double deviation = 0;  // standard
};

/// Moments of a level's valid pixels.
Moments momentsOf(const PyramidLevel& level) {
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
  if (!(n > 0)) return {};
  const double mean = sum / n;
  return {mean, std::sqrt(std::max(0.0, squares / n - mean * mean))};
}

const PyramidLevel& coarsest(const Frame& frame) {
  return frame.level(frame.pyramid().levels() - 1);
}

/// Standard deviation of the coarsest level, where noise has gone [grey levels].
double contrast(const Frame& frame) {
  return momentsOf(coarsest(frame)).deviation;
}

}  // namespace

double noiseOf(const PyramidLevel& level) {
  std::vector<float> left;
  for (int y = 1; y + 1 < level.height(); y += 2) {
    const float* up = level.row(y - 1);
    const float* row = level.row(y);
    const float* down = level.row(y + 1);
    for (int x = 1; x + 1 < level.width(); x += 2) {
      const float mask = up[x - 1] + up[x + 1] + down[x - 1] + down[x + 1] -
                         2 * (up[x] + down[x] + row[x - 1] + row[x + 1]) + 4 * row[x];
      if (std::isfinite(mask)) left.push_back(std::abs(mask));
    }
  }
  constexpr double kGainOfMask = 6;
  return kMadToSigma * static_cast<double>(medianInPlace(left)) / kGainOfMask;
}

bool isBlank(const Frame& frame, const Frame& beside) {
  const double exposed = std::min(1.0, frame.exposure() / beside.exposure());
  return contrast(frame) < kBlankShare * exposed * contrast(beside);
}

bool isRepeated(const Frame& frame, const Frame& before) {
  const int level = std::min(kRepeatedLevel, frame.pyramid().levels() - 1);
  const PyramidLevel& now = frame.level(level);
  const PyramidLevel& then = before.level(level);
  const double bound = kRepeatedShare * contrast(frame);
  double sum = 0;
  for (int y = 0; y < now.height(); ++y) {
    const float* a = now.row(y);
    const float* b = then.row(y);
    float row = 0;
    for (int x = 0; x < now.width(); ++x) {
      const float difference = a[x] - b[x];
      row += difference * difference > 0 ? difference * difference : 0;  // NaN is none
    }
    sum += static_cast<double>(row);
    if (sum > bound * bound * now.width() * now.height()) return false;
  }
  return bound > 0;
}

std::optional<GreyScale> GreyScale::of(const Frame& frame) {
  const Moments seen = momentsOf(coarsest(frame));
  if (seen.deviation >= kLeastContrast && seen.deviation <= kMostContrast) return GreyScale{};
  if (!(seen.deviation > 0)) return std::nullopt;
  const double noise = noiseOf(frame.level(0));
  const double gain = std::min(kUsualContrast / seen.deviation,
                               noise > 0 ? std::max(1.0, kUsualNoise / noise) : INFINITY);
  if (gain == 1) return GreyScale{};
  return GreyScale{static_cast<float>(gain), static_cast<float>(kMiddleGrey - gain * seen.mean)};
}

bool GreyScale::suits(const Frame& frame) const {
  if (gain <= 1) return true;
  const Moments seen = momentsOf(coarsest(frame));
  const double mean = static_cast<double>(gain) * seen.mean + static_cast<double>(offset);
  return static_cast<double>(gain) * seen.deviation <= kMostContrast && mean >= 0 &&
         mean <= 2 * kMiddleGrey;
}

FramePtr GreyScale::apply(const FramePtr& frame) const {
  const PyramidLevel& level = frame->level(0);
  std::vector<float> pixels(level.data(),
                            level.data() + std::ptrdiff_t{level.width()} * level.height());
  for (float& pixel : pixels) pixel = gain * pixel + offset;
  FrameInfo info{frame->id(), frame->timestamp(), frame->exposure()};
  // They belong to the frame, which they keep alive.
  if (frame->rowTimes() != nullptr) info.row_times = {frame, frame->rowTimes()};
  if (frame->priors() != nullptr) info.priors = {frame, frame->priors()};
  return Frame::create({pixels.data(), level.width(), level.height()}, info);
}

}  // namespace dsorb
