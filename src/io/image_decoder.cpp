// SPDX-License-Identifier: BSD-3-Clause
#include "io/image_decoder.h"

#include "dsorb/error.h"

#include "io/jpeg_decoder.h"

#include <fmt/format.h>
#include <opencv2/imgcodecs.hpp>

#include <algorithm>
#include <array>
#include <cctype>
#include <fstream>
#include <string_view>

namespace dsorb {
namespace {

constexpr std::array<std::string_view, 9> kImageSuffixes = {
    ".png", ".jpg", ".jpeg", ".pgm", ".ppm", ".pnm", ".bmp", ".tif", ".tiff"};

bool startsWith(const std::vector<std::uint8_t>& bytes, std::string_view magic) {
  return bytes.size() >= magic.size() &&
         std::equal(magic.begin(), magic.end(), bytes.begin(), [](char m, std::uint8_t b) {
           return static_cast<std::uint8_t>(m) == b;
         });
}

/// Whether all chunks of a PNG up to its end mark are there.
bool completePng(const std::vector<std::uint8_t>& bytes) {
  constexpr std::size_t kSignature = 8;
  constexpr std::size_t kChunkFrame = 12;  // length, type, checksum
  std::size_t at = kSignature;
  while (at + kChunkFrame <= bytes.size()) {
    const std::size_t length = (static_cast<std::size_t>(bytes[at]) << 24) |
                               (static_cast<std::size_t>(bytes[at + 1]) << 16) |
                               (static_cast<std::size_t>(bytes[at + 2]) << 8) | bytes[at + 3];
    const std::string_view type(reinterpret_cast<const char*>(&bytes[at + 4]), 4);
    at += kChunkFrame + length;
    if (type == "IEND") return at <= bytes.size();
  }
  return false;
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
  if (startsWith(bytes, "\x89PNG\r\n\x1a\n")) return completePng(bytes);
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
  cv::Mat image;
  if (isJpeg(bytes)) image = decodeJpeg(bytes, name);
  if (!image.empty()) return image;
  try {
    image = cv::imdecode(
        bytes, cv::IMREAD_GRAYSCALE | cv::IMREAD_ANYDEPTH | cv::IMREAD_IGNORE_ORIENTATION);
  } catch (const cv::Exception&) {
    image.release();  // reported below like any other image that cannot be decoded
  }
  if (image.empty()) throw IoError(fmt::format("{}: the image cannot be decoded", name));
  if (image.type() != CV_8UC1 && image.type() != CV_16UC1) {
    throw IoError(fmt::format("{}: neither 8 nor 16 bits a channel", name));
  }
  return image;
}

bool hasImageSuffix(const std::filesystem::path& file) {
  std::string suffix = file.extension().string();
  std::transform(suffix.begin(), suffix.end(), suffix.begin(), [](unsigned char c) {
    return static_cast<char>(std::tolower(c));
  });
  return std::find(kImageSuffixes.begin(), kImageSuffixes.end(), suffix) != kImageSuffixes.end();
}

}  // namespace dsorb
