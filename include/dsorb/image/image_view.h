// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/cxx17.h"

#include <cstddef>
#include <cstdint>
#include <stdexcept>
#include <string>
#include <type_traits>

namespace dsorb {

/// Non-owning view of a row-major grey image. A float pixel that is NaN is invalid: outside the
/// field of view, without vignette, or marked by the caller (saturated pixels may be; our readers
/// leave them, because the edges of bright areas are worth more than their levels are wrong); an
/// 8-bit image has no invalid pixels.
class ImageView {
 public:
  /// Type of a pixel.
  enum class Type { kUint8, kFloat };

  /// A view of no image.
  ImageView() = default;
  /// @param stride_bytes distance between rows [bytes]; 0 means contiguous rows
  /// @throws std::invalid_argument when the distance is shorter than a row or no multiple of a
  /// pixel
  ImageView(const std::uint8_t* data, int width, int height, std::size_t stride_bytes = 0)
      : ImageView(data, Type::kUint8, width, height, stride_bytes) {}
  /// The same for float pixels.
  ImageView(const float* data, int width, int height, std::size_t stride_bytes = 0)
      : ImageView(data, Type::kFloat, width, height, stride_bytes) {}

  /// Type of the pixels.
  [[nodiscard]] Type type() const { return type_; }
  /// Width [px].
  [[nodiscard]] int width() const { return width_; }
  /// Height [px].
  [[nodiscard]] int height() const { return height_; }
  /// Without data or without pixels.
  [[nodiscard]] bool empty() const { return data_ == nullptr || width_ <= 0 || height_ <= 0; }

  /// @tparam Pixel std::uint8_t or float; must agree with type()
  template <typename Pixel>
  [[nodiscard]] const Pixel* row(int y) const {
    static_assert(std::is_same_v<Pixel, std::uint8_t> || std::is_same_v<Pixel, float>);
    return reinterpret_cast<const Pixel*>(static_cast<const char*>(data_) +
                                          static_cast<std::size_t>(y) * stride_);
  }

 private:
  ImageView(const void* data, Type type, int width, int height, std::size_t stride_bytes)
      : data_(data), type_(type), width_(width), height_(height), stride_(stride_bytes) {
    const std::size_t pixel_bytes = type == Type::kFloat ? sizeof(float) : 1;
    const std::size_t row_bytes = pixel_bytes * static_cast<std::size_t>(width > 0 ? width : 0);
    if (stride_ == 0) stride_ = row_bytes;
    if (stride_ >= row_bytes && stride_ % pixel_bytes == 0) return;
    throw std::invalid_argument("stride of " + std::to_string(stride_) +
                                " bytes: expected whole pixels, at least the " +
                                std::to_string(row_bytes) + " bytes of a row");
  }

  const void* data_ = nullptr;
  Type type_ = Type::kUint8;
  int width_ = 0;
  int height_ = 0;
  std::size_t stride_ = 0;
};

}  // namespace dsorb
