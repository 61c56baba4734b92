// SPDX-License-Identifier: BSD-3-Clause
#include "camera/photometric_correction.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <stdexcept>
#include <vector>

namespace dsorb {
namespace {

constexpr int kVignetteWidth = 16;
constexpr int kVignetteHeight = 16;
constexpr std::size_t kPixels = kVignetteWidth * kVignetteHeight;

/// Inverse response G(Y) = 255 (Y / (N - 1))^exponent.
std::vector<float> powerResponse(std::size_t entries, double exponent) {
  std::vector<float> response(entries);
  for (std::size_t i = 0; i < entries; ++i) {
    const double position = static_cast<double>(i) / static_cast<double>(entries - 1);
    response[i] = static_cast<float>(255 * std::pow(position, exponent));
  }
  return response;
}

PhotometricCalibration calibration(std::size_t entries = 256, double exponent = 2) {
  PhotometricCalibration result;
  result.response = powerResponse(entries, exponent);
  result.vignette.assign(kPixels, 1.0F);
  result.vignette_width = kVignetteWidth;
  result.vignette_height = kVignetteHeight;
  return result;
}

template <typename Pixel>
std::vector<Pixel> allValues(int step) {
  std::vector<Pixel> raw(kPixels);
  for (std::size_t i = 0; i < kPixels; ++i) {
    raw[i] = static_cast<Pixel>(static_cast<int>(i) * step);
  }
  return raw;
}

template <typename Pixel>
std::vector<float> corrected(const PhotometricCorrection& correction,
                             const std::vector<Pixel>& raw) {
  std::vector<float> result(kPixels);
  correction.apply(raw.data(), kVignetteWidth * sizeof(Pixel), result.data());
  return result;
}

TEST(PhotometricCorrectionTest, WithoutCalibrationGreyLevelsStayExactlyAsTheyAre) {
  const auto result =
      corrected(PhotometricCorrection(kVignetteWidth, kVignetteHeight), allValues<std::uint8_t>(1));
  for (std::size_t i = 0; i < kPixels; ++i) EXPECT_EQ(result[i], static_cast<float>(i));
}

TEST(PhotometricCorrectionTest, SixteenBitsKeepTheirPrecision) {
  const PhotometricCorrection correction(kVignetteWidth, kVignetteHeight);
  const auto coarse = corrected(correction, allValues<std::uint16_t>(257));
  for (std::size_t i = 0; i < kPixels; ++i) EXPECT_FLOAT_EQ(coarse[i], static_cast<float>(i));
  const auto fine = corrected(correction, allValues<std::uint16_t>(1));
  for (std::size_t i = 0; i < kPixels; ++i) {
    EXPECT_FLOAT_EQ(fine[i], static_cast<float>(i) / 257.0F);
  }
}

TEST(PhotometricCorrectionTest, ResponseIsLookedUpAndVignetteDividedOut) {
  PhotometricCalibration c = calibration();
  c.vignette[100] = 0.5F;
  const auto result = corrected(PhotometricCorrection(c, kVignetteWidth, kVignetteHeight),
                                allValues<std::uint8_t>(1));
  for (std::size_t i = 0; i < kPixels; ++i) {
    const double gain = i == 100 ? 2 : 1;
    const auto value = static_cast<double>(i) / 255;
    EXPECT_NEAR(result[i], gain * 255 * value * value, 1e-4) << i;
  }
}

TEST(PhotometricCorrectionTest, TablesOfAnyLengthCoverImagesOfAnyDepth) {
  for (const std::size_t entries : {256U, 1024U, 65536U}) {
    const PhotometricCorrection correction(calibration(entries), kVignetteWidth, kVignetteHeight);
    const auto from8 = corrected(correction, allValues<std::uint8_t>(1));
    const auto from16 = corrected(correction, allValues<std::uint16_t>(257));
    for (std::size_t i = 0; i < kPixels; ++i) {
      const auto value = static_cast<double>(i) / 255;
      EXPECT_NEAR(from8[i], 255 * value * value, 1e-3) << entries << " entries, value " << i;
      EXPECT_NEAR(from16[i], from8[i], 1e-3) << entries << " entries, value " << i;
    }
  }
}

TEST(PhotometricCorrectionTest, PixelsWithoutLightAreInvalid) {
  PhotometricCalibration c = calibration();
  c.vignette[7] = 0;
  c.vignette[8] = 0.001F;
  const auto result = corrected(PhotometricCorrection(c, kVignetteWidth, kVignetteHeight),
                                allValues<std::uint8_t>(1));
  EXPECT_FALSE(std::isnan(result[6]));
  EXPECT_TRUE(std::isnan(result[7]));
  EXPECT_TRUE(std::isnan(result[8]));
}

TEST(PhotometricCorrectionTest, RowsMayBePadded) {
  constexpr std::size_t kStride = 20;
  std::vector<std::uint8_t> raw(kStride * kVignetteHeight, 255);
  for (std::size_t y = 0; y < kVignetteHeight; ++y) {
    for (std::size_t x = 0; x < kVignetteWidth; ++x)
      raw[y * kStride + x] = static_cast<std::uint8_t>(y);
  }
  std::vector<float> result(kPixels);
  PhotometricCorrection(kVignetteWidth, kVignetteHeight).apply(raw.data(), kStride, result.data());
  for (std::size_t i = 0; i < kPixels; ++i) {
    EXPECT_EQ(result[i], static_cast<float>(i / kVignetteWidth));
  }
}

TEST(PhotometricCorrectionTest, SlopeIsOneWhereTheResponseIsLinear) {
  for (const float slope : PhotometricCorrection(kVignetteWidth, kVignetteHeight).responseSlope()) {
    EXPECT_FLOAT_EQ(slope, 1);
  }
}

TEST(PhotometricCorrectionTest, SlopeIsTheDerivativeOfTheForwardResponse) {
  // Raw value of corrected level v: B(v) = 255 sqrt(v / 255).
  const auto B = [](double v) { return 255 * std::sqrt(v / 255); };
  for (const std::size_t entries : {256U, 4096U}) {
    const auto slope = PhotometricCorrection(calibration(entries), kVignetteWidth, kVignetteHeight)
                           .responseSlope();
    for (std::size_t v = 5; v <= 250; ++v) {
      const auto level = static_cast<double>(v);
      // Linear inversion of the table: measured at most 0.0022 apart (at level 10), margin x2.
      EXPECT_NEAR(slope[v], B(level + 1) - B(level), 0.005) << entries << " entries, level " << v;
    }
    EXPECT_EQ(slope[0], slope[5]);  // the ends of the range are not trusted
    EXPECT_EQ(slope[255], slope[250]);
  }
}

TEST(PhotometricCorrectionTest, RefusesTablesThatAreNoResponse) {
  PhotometricCalibration few = calibration(255);
  EXPECT_THROW(PhotometricCorrection(few, kVignetteWidth, kVignetteHeight), std::invalid_argument);
  PhotometricCalibration flat = calibration();
  flat.response[100] = flat.response[99];
  EXPECT_THROW(PhotometricCorrection(flat, kVignetteWidth, kVignetteHeight), std::invalid_argument);
  EXPECT_THROW(PhotometricCorrection(calibration(), kVignetteWidth, kVignetteHeight + 1),
               std::invalid_argument);
  PhotometricCalibration scaled = calibration();
  for (float& level : scaled.response) level *= 10;
  EXPECT_THROW(PhotometricCorrection(scaled, kVignetteWidth, kVignetteHeight),
               std::invalid_argument);
  for (const float attenuation : {-0.1F, 2.0F, std::nanf("")}) {
    PhotometricCalibration bright = calibration();
    bright.vignette[3] = attenuation;
    EXPECT_THROW(PhotometricCorrection(bright, kVignetteWidth, kVignetteHeight),
                 std::invalid_argument)
        << attenuation;
  }
}

}  // namespace
}  // namespace dsorb
