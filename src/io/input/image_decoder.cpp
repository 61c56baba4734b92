// SPDX-License-Identifier: BSD-3-Clause
#include "io/input/image_decoder.h"

#include "dsorb/error.h"

#include "io/input/codecs.h"
#include "io/input/image_header.h"
#include "io/input/jpeg_decoder.h"
#include "io/png.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <fstream>
#include <string_view>

namespace dsorb {
namespace {

constexpr std::array<std::string_view, 10> kImageSuffixes = {
    ".png", ".jpg", ".jpeg", ".pgm", ".ppm", ".pnm", ".bmp", ".tif", ".tiff", ".webp"};

bool startsWith(const std::vector<std::uint8_t>& bytes, std::string_view magic) {
  return bytes.size() >= magic.size() &&
         std::equal(magic.begin(), magic.end(), bytes.begin(), [](char m, std::uint8_t b) {
           return static_cast<std::uint8_t>(m) == b;
         });
}

/// Whether OpenCV is asked to decode this: PNM, BMP, TIFF, WebP, and what libjpeg does not convert.
/// The rest it would hand to GDAL, and to GDCM, which aborts over a damaged DICOM file.
bool isLeftToOpenCv(const std::vector<std::uint8_t>& bytes) {
  using namespace std::string_view_literals;
  if (startsWith(bytes, "P")) {
    return bytes.size() > 2 && bytes[1] >= '1' && bytes[1] <= '6' && std::isspace(bytes[2]) != 0;
  }
  return isJpeg(bytes) || startsWith(bytes, "BM") || startsWith(bytes, "II*\0"sv) ||
         startsWith(bytes, "MM\0*"sv) || startsWith(bytes, "RIFF");
}

/// Whether a binary PGM or PPM holds the pixels its header announces: "P5 width height maximum"
/// and one more white space.
bool completePnm(const std::vector<std::uint8_t>& bytes, std::size_t channels) {
  std::array<std::size_t, 3> header{};
  std::size_t at = 2;
  for (std::size_t& number : header) {
    while (at < bytes.size() && std::isdigit(bytes[at]) == 0) {
      const bool comment = bytes[at++] == '#';
      while (comment && at < bytes.size() && bytes[at] != '\n') ++at;
    }
    constexpr std::size_t kTooLarge = 1000000;
    while (at < bytes.size() && std::isdigit(bytes[at]) != 0 && number < kTooLarge) {
      number = 10 * number + (bytes[at++] - std::size_t{'0'});
    }
  }
  const std::size_t bytes_per_value = header[2] > 255 ? 2 : 1;
  return at + 1 + header[0] * header[1] * channels * bytes_per_value <= bytes.size();
}

bool complete(const std::vector<std::uint8_t>& bytes) {
  if (startsWith(bytes, "P5")) return completePnm(bytes, 1);
  if (startsWith(bytes, "P6")) return completePnm(bytes, 3);
  return !bytes.empty();
}

}  // namespace

std::vector<std::uint8_t> readFile(const std::filesystem::path& file) {
  std::error_code error;
  const auto size = std::filesystem::file_size(file, error);  // none of what is no regular file
  if (error) throw IoError(fmt::format("{}: cannot be read: {}", file.string(), error.message()));
  if (size > kMaxImageBytes) {
    throw IoError(fmt::format("{}: {} MiB are too many for an image", file.string(), size >> 20U));
  }
  std::ifstream stream(file, std::ios::binary);
  if (!stream) throw IoError(fmt::format("{}: cannot be read", file.string()));
  std::vector<std::uint8_t> bytes(size);
  if (size > 0 &&
      !stream.read(reinterpret_cast<char*>(bytes.data()), static_cast<std::streamsize>(size))) {
    throw IoError(fmt::format("{}: cannot be read", file.string()));
  }
  return bytes;
}

cv::Mat decodeGrey(const std::vector<std::uint8_t>& bytes, const std::string& name) {
  if (!complete(bytes)) throw IoError(fmt::format("{}: the image is truncated", name));
  const std::optional<cv::Size> size = sizeInHeader(bytes);
  if (size && std::int64_t{size->width} * size->height > kMaxPixels) {
    throw IoError(fmt::format("{}: {}x{} px; expected {} megapixels at most",
                              name,
                              size->width,
                              size->height,
                              kMaxPixels >> 20U));
  }
  if (isPng(bytes)) return decodePng(bytes, name);
  cv::Mat image;
  if (isJpeg(bytes)) image = decodeJpeg(bytes, name);
  if (image.empty() && size && isLeftToOpenCv(bytes)) image = decodeByOpenCv(bytes);
  if (image.empty()) {
    throw IoError(fmt::format(
        "{}: the image cannot be decoded; expected PNG, JPEG, PNM, BMP, TIFF or WebP", name));
  }
  if (image.type() != CV_8UC1 && image.type() != CV_16UC1) {
    throw IoError(fmt::format("{}: neither 8 nor 16 bits a channel", name));
  }
  return image;
}

std::string lowerSuffix(const std::filesystem::path& file) {
  std::string suffix = file.extension().string();
  std::transform(suffix.begin(), suffix.end(), suffix.begin(), [](unsigned char c) {
    return static_cast<char>(std::tolower(c));
  });
  return suffix;
}

bool hasImageSuffix(const std::filesystem::path& file) {
  return std::find(kImageSuffixes.begin(), kImageSuffixes.end(), lowerSuffix(file)) !=
         kImageSuffixes.end();
}

}  // namespace dsorb
