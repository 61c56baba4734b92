// SPDX-License-Identifier: BSD-3-Clause
#include "io/input/image_header.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cstddef>
#include <limits>
#include <string_view>

namespace dsorb {
namespace {

using namespace std::string_view_literals;

/// Bytes with positions that need not exist: there they are 0.
struct Bytes {
  const std::vector<std::uint8_t>& data;

  [[nodiscard]] std::uint32_t at(std::size_t i) const { return i < data.size() ? data[i] : 0; }
  [[nodiscard]] std::uint32_t big(std::size_t i, int count) const {
    std::uint32_t value = 0;
    for (int k = 0; k < count; ++k) value = value << 8U | at(i + static_cast<std::size_t>(k));
    return value;
  }
  [[nodiscard]] std::uint32_t little(std::size_t i, int count) const {
    std::uint32_t value = 0;
    for (int k = count; k-- > 0;) value = value << 8U | at(i + static_cast<std::size_t>(k));
    return value;
  }
  [[nodiscard]] std::uint32_t number(std::size_t i, int count, bool is_big) const {
    return is_big ? big(i, count) : little(i, count);
  }
  [[nodiscard]] bool has(std::string_view text, std::size_t i = 0) const {
    if (data.size() < i + text.size()) return false;
    for (std::size_t k = 0; k < text.size(); ++k) {
      if (data[i + k] != static_cast<std::uint8_t>(text[k])) return false;
    }
    return true;
  }
};

std::optional<cv::Size> sizeOf(std::uint32_t width, std::uint32_t height) {
  constexpr std::uint32_t kMost = std::numeric_limits<int>::max();
  if (width == 0 || height == 0 || width > kMost || height > kMost) return std::nullopt;
  return cv::Size(static_cast<int>(width), static_cast<int>(height));
}

/// Segments FF xx length, until one of the frame headers C0 to CF that are none of DHT, JPG, DAC.
std::optional<cv::Size> jpegSize(const Bytes& b) {
  for (std::size_t i = 2; i + 9 < b.data.size();) {
    if (b.at(i) != 0xFF) return std::nullopt;
    const std::uint32_t marker = b.at(i + 1);
    if (marker == 0xFF) {  // padding
      ++i;
      continue;
    }
    const bool frame =
        (marker & 0xF0U) == 0xC0 && marker != 0xC4 && marker != 0xC8 && marker != 0xCC;
    if (frame) return sizeOf(b.big(i + 7, 2), b.big(i + 5, 2));
    if (marker == 0xDA || marker == 0xD9) return std::nullopt;
    i += 2 + b.big(i + 2, 2);
  }
  return std::nullopt;
}

/// "P5 width height", comments between.
std::optional<cv::Size> pnmSize(const Bytes& b) {
  std::array<std::uint32_t, 2> numbers{};
  std::size_t i = 2;
  for (std::uint32_t& number : numbers) {
    while (i < b.data.size() && std::isdigit(b.data[i]) == 0) {
      const bool comment = b.data[i++] == '#';
      while (comment && i < b.data.size() && b.data[i] != '\n') ++i;
    }
    constexpr std::uint32_t kTooLarge = 100000000;
    while (std::isdigit(static_cast<int>(b.at(i))) != 0 && number < kTooLarge) {
      number = 10 * number + (b.at(i++) - '0');
    }
  }
  return sizeOf(numbers[0], numbers[1]);
}

/// The entries 256 and 257 of the first directory.
std::optional<cv::Size> tiffSize(const Bytes& b) {
  const bool big = b.at(0) == 'M';
  const std::size_t directory = b.number(4, 4, big);
  const std::uint32_t entries = b.number(directory, 2, big);
  std::array<std::uint32_t, 2> numbers{};
  for (std::uint32_t k = 0; k < entries; ++k) {
    const std::size_t entry = directory + 2 + std::size_t{12} * k;
    if (entry >= b.data.size()) break;
    const std::uint32_t tag = b.number(entry, 2, big);
    const int bytes = b.number(entry + 2, 2, big) == 3 ? 2 : 4;  // SHORT or LONG
    if (tag == 256 || tag == 257) numbers.at(tag - 256) = b.number(entry + 8, bytes, big);
  }
  return sizeOf(numbers[0], numbers[1]);
}

std::optional<cv::Size> webpSize(const Bytes& b) {
  if (b.has("VP8X", 12)) return sizeOf(1 + b.little(24, 3), 1 + b.little(27, 3));
  if (b.has("VP8 ", 12)) return sizeOf(b.little(26, 2) & 0x3FFFU, b.little(28, 2) & 0x3FFFU);
  if (!b.has("VP8L", 12)) return std::nullopt;
  const std::uint32_t bits = b.little(21, 4);
  return sizeOf(1 + (bits & 0x3FFFU), 1 + (bits >> 14U & 0x3FFFU));
}

}  // namespace

std::optional<cv::Size> sizeInHeader(const std::vector<std::uint8_t>& bytes) {
  const Bytes b{bytes};
  if (b.has("\x89PNG"sv)) return sizeOf(b.big(16, 4), b.big(20, 4));
  if (b.has("\xFF\xD8\xFF"sv)) return jpegSize(b);
  if (b.has("BM")) return sizeOf(b.little(18, 4), std::min(b.little(22, 4), 0U - b.little(22, 4)));
  if (b.has("II*\0"sv) || b.has("MM\0*"sv)) return tiffSize(b);
  if (b.has("RIFF") && b.has("WEBP", 8)) return webpSize(b);
  if (b.at(0) == 'P' && b.at(1) >= '1' && b.at(1) <= '6') return pnmSize(b);
  return std::nullopt;
}

}  // namespace dsorb
