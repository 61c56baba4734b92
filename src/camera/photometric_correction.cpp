// SPDX-License-Identifier: BSD-3-Clause
#include "camera/photometric_correction.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

namespace dsorb {
namespace {

constexpr std::size_t kEntries8 = 1 << 8;
constexpr std::size_t kEntries16 = 1 << 16;
constexpr float kMaxLevel = 255;
// Below this the correction multiplies noise of one grey level to more than a third of the range.
constexpr float kMinVignette = 0.01F;
// Corrected levels between which the slope is looked up: near the ends of the range the response
// is not measured well.
constexpr int kMinSlopeLevel = 5;
constexpr int kMaxSlopeLevel = 250;

/// Response over `entries` raw values that cover the same range, linearly interpolated.
std::vector<float> resampled(const std::vector<float>& response, std::size_t entries) {
  std::vector<float> table(entries);
  const double scale = static_cast<double>(response.size() - 1) / static_cast<double>(entries - 1);
  for (std::size_t i = 0; i < entries; ++i) {
    const double position = static_cast<double>(i) * scale;
    const std::size_t low = std::min(static_cast<std::size_t>(position), response.size() - 2);
    const double below = response[low];
    const double step = static_cast<double>(response[low + 1]) - below;
    table[i] = static_cast<float>(below + (position - static_cast<double>(low)) * step);
  }
  return table;
}

void checkResponse(const std::vector<float>& response) {
  if (response.size() < kMinResponseEntries) {
    throw std::invalid_argument("response of " + std::to_string(response.size()) +
                                " entries: at least " + std::to_string(kMinResponseEntries) +
                                " are expected");
  }
  for (std::size_t i = 1; i < response.size(); ++i) {
    if (!(response[i] > response[i - 1]) || !std::isfinite(response[i])) {
      throw std::invalid_argument("response does not increase at entry " + std::to_string(i));
    }
  }
  if (!(response.front() >= 0) || std::abs(response.back() - kMaxLevel) > 1) {
    throw std::invalid_argument("response from " + std::to_string(response.front()) + " to " +
                                std::to_string(response.back()) +
                                ": expected irradiances that end at 255");
  }
}

void checkVignette(const std::vector<float>& attenuation) {
  constexpr float kRounding = 1e-3F;
  for (const float value : attenuation) {
    if (value >= 0 && value <= 1 + kRounding) continue;
    throw std::invalid_argument("vignette has the attenuation " + std::to_string(value) +
                                ": expected 0 to 1");
  }
}

}  // namespace

PhotometricCorrection::PhotometricCorrection(int width, int height)
    : width_(width),
      height_(height),
      response_({0, kMaxLevel}),
      table8_(resampled(response_, kEntries8)),
      table16_(resampled(response_, kEntries16)) {}

PhotometricCorrection::PhotometricCorrection(const PhotometricCalibration& calibration,
                                             int width,
                                             int height)
    : width_(width), height_(height) {
  checkResponse(calibration.response);
  const std::size_t pixels = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
  if (calibration.vignette_width != width || calibration.vignette_height != height ||
      calibration.vignette.size() != pixels) {
    throw std::invalid_argument("vignette of " + std::to_string(calibration.vignette_width) + "x" +
                                std::to_string(calibration.vignette_height) +
                                " pixels for images of " + std::to_string(width) + "x" +
                                std::to_string(height));
  }
  checkVignette(calibration.vignette);
  response_ = calibration.response;
  table8_ = resampled(response_, kEntries8);
  table16_ = resampled(response_, kEntries16);
  gain_.resize(pixels);
  std::transform(calibration.vignette.begin(),
                 calibration.vignette.end(),
                 gain_.begin(),
                 [](float attenuation) {
                   return attenuation >= kMinVignette ? 1.0F / attenuation
                                                      : std::numeric_limits<float>::quiet_NaN();
                 });
}

void PhotometricCorrection::setBits(int bits) {
  table16_ = resampled(response_, std::size_t{1} << static_cast<unsigned>(bits));
  table16_.resize(kEntries16, table16_.back());
}

template <>
const float* PhotometricCorrection::table<std::uint8_t>() const {
  return table8_.data();
}

template <>
const float* PhotometricCorrection::table<std::uint16_t>() const {
  return table16_.data();
}

template <typename Pixel>
void PhotometricCorrection::apply(const Pixel* raw,
                                  std::size_t stride_bytes,
                                  float* corrected) const {
  const float* levels = table<Pixel>();
  const auto* row = reinterpret_cast<const char*>(raw);
  const float* gain = gain_.data();
  for (int y = 0; y < height_; ++y, row += stride_bytes, corrected += width_) {
    const auto* pixels = reinterpret_cast<const Pixel*>(row);
    for (int x = 0; x < width_; ++x) corrected[x] = levels[pixels[x]];
    if (gain_.empty()) continue;
    for (int x = 0; x < width_; ++x) corrected[x] *= gain[x];
    gain += width_;
  }
}

template void PhotometricCorrection::apply<std::uint8_t>(const std::uint8_t*,
                                                         std::size_t,
                                                         float*) const;
template void PhotometricCorrection::apply<std::uint16_t>(const std::uint16_t*,
                                                          std::size_t,
                                                          float*) const;

std::array<float, 256> PhotometricCorrection::responseSlope() const {
  // Raw value at every whole corrected level: inverse of the increasing table.
  std::array<float, 256> raw{};
  std::size_t low = 0;
  for (std::size_t level = 0; level < raw.size(); ++level) {
    const auto value = static_cast<float>(level);
    while (low + 2 < table8_.size() && table8_[low + 1] < value) ++low;
    raw[level] =
        static_cast<float>(low) + (value - table8_[low]) / (table8_[low + 1] - table8_[low]);
  }
  std::array<float, 256> slope{};
  for (std::size_t level = 0; level < slope.size(); ++level) {
    const int c = std::clamp(static_cast<int>(level), kMinSlopeLevel, kMaxSlopeLevel);
    const auto i = static_cast<std::size_t>(c);
    slope[level] = raw[i + 1] - raw[i];
  }
  return slope;
}

}  // namespace dsorb
