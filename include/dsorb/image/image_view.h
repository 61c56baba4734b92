// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <type_traits>

namespace dsorb {

/// Non-owning view of a row-major grey image. A float pixel that is NaN is invalid (outside the
/// field of view, saturated, without vignette); an 8-bit image has no invalid pixels.
class ImageView {
 public:
  enum class Type { kUint8, kFloat };

  ImageView() = default;
  /// @param stride_bytes distance between rows [bytes]; 0 means contiguous rows
  ImageView(const std::uint8_t* data, int width, int height, std::size_t stride_bytes = 0)
      : data_(data),
        width_(width),
        height_(height),
        stride_(stride_bytes != 0 ? stride_bytes : static_cast<std::size_t>(width)) {}
  ImageView(const float* data, int width, int height, std::size_t stride_bytes = 0)
      : data_(data),
        type_(Type::kFloat),
        width_(width),
        height_(height),
        stride_(stride_bytes != 0 ? stride_bytes
                                  : static_cast<std::size_t>(width) * sizeof(float)) {}

  [[nodiscard]] Type type() const { return type_; }
  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }
  [[nodiscard]] bool empty() const { return data_ == nullptr || width_ <= 0 || height_ <= 0; }

  /// @tparam Pixel std::uint8_t or float; must agree with type()
  template <typename Pixel>
  [[nodiscard]] const Pixel* row(int y) const {
    static_assert(std::is_same_v<Pixel, std::uint8_t> || std::is_same_v<Pixel, float>);
    return reinterpret_cast<const Pixel*>(static_cast<const char*>(data_) +
                                          static_cast<std::size_t>(y) * stride_);
  }

 private:
  const void* data_ = nullptr;
  Type type_ = Type::kUint8;
  int width_ = 0;
  int height_ = 0;
  std::size_t stride_ = 0;
};

}  // namespace dsorb
