// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/rectifier.h"
#include "dsorb/geometry/se3.h"
#include "dsorb/image/image_view.h"

#include <nanobind/nanobind.h>
#include <nanobind/ndarray.h>

#include <cstddef>
#include <optional>
#include <vector>

namespace dsorb::python {

namespace nb = nanobind;

/// An array of the caller's, read where it lies.
using AnyArray = nb::ndarray<nb::ro, nb::device::cpu>;
/// (4, 4), maps homogeneous coordinates.
using Matrix4 = nb::ndarray<nb::numpy, double, nb::shape<4, 4>>;
/// (6, 6), [translation; rotation].
using Covariance = nb::ndarray<nb::numpy, double, nb::shape<6, 6>>;

/// An argument as array. @throws nb::type_error where it is none, or a masked one, whose mask would
/// be lost
AnyArray arrayFrom(nb::handle argument);

/// View of a rectified image: (height, width) of uint8 or float32, pixels of a row side by side.
/// @throws std::invalid_argument naming what the array is instead
ImageView rectifiedView(const AnyArray& array);

/// View of a depth image: (height, width) of float32, pixels of a row side by side.
/// @throws std::invalid_argument naming what the array is instead
ImageView depthView(const AnyArray& array);

/// View of a camera's image: (height, width) of uint8 or uint16, or (height, width, 3) of uint8.
/// @param rgb order of three channels; false: blue comes first, as OpenCV has it
/// @throws std::invalid_argument naming what the array is instead
RawImage rawView(const AnyArray& array, bool rgb);

/// A mask as the library takes it: 255 where pixels are valid. Arrays of bool are copied.
class Mask {
 public:
  /// @param array (height, width) of bool, or of uint8 and below 128 where pixels are invalid
  /// @throws std::invalid_argument naming what the array is instead
  explicit Mask(const std::optional<AnyArray>& array);
  [[nodiscard]] const ImageView& view() const { return view_; }

 private:
  std::vector<std::uint8_t> levels_;
  ImageView view_;
};

/// A new array that takes the values over.
template <typename Array, typename Value>
Array arrayOf(std::vector<Value> values, std::initializer_list<std::size_t> shape) {
  auto* const kept = new std::vector<Value>(std::move(values));
  nb::capsule owner(kept, [](void* p) noexcept { delete static_cast<std::vector<Value>*>(p); });
  return Array(kept->data(), shape, owner);
}

Matrix4 matrixOf(const SE3& pose);
std::optional<Matrix4> matrixOf(const std::optional<SE3>& pose);
std::optional<Covariance> covarianceOf(const std::optional<Matrix6d>& matrix);

}  // namespace dsorb::python
