// SPDX-License-Identifier: BSD-3-Clause
#include "python/arrays.h"

#include <cstdint>
#include <stdexcept>
#include <string>

namespace dsorb::python {
namespace {

std::string describe(const AnyArray& array) {
  std::string text = "an array of shape (";
  for (std::size_t i = 0; i < array.ndim(); ++i) {
    text += (i == 0 ? "" : ", ") + std::to_string(array.shape(i));
  }
  const nb::dlpack::dtype type = array.dtype();
  const char* kind = type == nb::dtype<bool>()                                  ? "bool"
                     : type.code == std::uint8_t(nb::dlpack::dtype_code::Float) ? "float"
                     : type.code == std::uint8_t(nb::dlpack::dtype_code::Int)   ? "int"
                     : type.code == std::uint8_t(nb::dlpack::dtype_code::UInt)  ? "uint"
                                                                                : "type code";
  return text + ") and " + kind + (type == nb::dtype<bool>() ? "" : std::to_string(type.bits));
}

/// @throws std::invalid_argument where the pixels of a row do not lie side by side, or rows overlap
std::size_t rowBytes(const AnyArray& array) {
  const auto channels = array.ndim() == 3 ? static_cast<std::int64_t>(array.shape(2)) : 1;
  const auto row = static_cast<std::int64_t>(array.shape(1)) * channels;
  const bool dense = (array.ndim() != 3 || array.stride(2) == 1) && array.stride(1) == channels &&
                     (array.shape(0) < 2 || array.stride(0) >= row);
  if (!dense) {
    throw std::invalid_argument(
        "the pixels of a row do not lie side by side, or rows overlap; numpy.ascontiguousarray "
        "makes an array where they do not");
  }
  return static_cast<std::size_t>(array.stride(0)) * array.itemsize();
}

int side(const AnyArray& array, std::size_t axis) {
  return static_cast<int>(array.shape(axis));
}

}  // namespace

AnyArray arrayFrom(nb::handle argument) {
  const std::string type = nb::str(argument.type().attr("__name__")).c_str();
  if (type == "MaskedArray") {
    throw nb::type_error(
        "a masked array: its mask would be lost; numpy.ma.filled makes an array of it, and "
        "Rectifier takes masks");
  }
  AnyArray array;
  if (nb::try_cast(argument, array)) return array;
  throw nb::type_error(("expected an array, found " + type).c_str());
}

ImageView depthView(const AnyArray& array) {
  if (array.ndim() != 2 || array.dtype() != nb::dtype<float>()) {
    throw std::invalid_argument(describe(array) +
                                ": expected a depth image, (height, width) of float32 [m]");
  }
  return {static_cast<const float*>(array.data()), side(array, 1), side(array, 0), rowBytes(array)};
}

ImageView rectifiedView(const AnyArray& array) {
  const bool grey = array.ndim() == 2 && array.dtype() == nb::dtype<std::uint8_t>();
  const bool real = array.ndim() == 2 && array.dtype() == nb::dtype<float>();
  if (!grey && !real) {
    throw std::invalid_argument(
        describe(array) +
        ": expected a rectified grey image, (height, width) of uint8 or float32; Rectifier makes "
        "one of what a camera gives");
  }
  const std::size_t stride = rowBytes(array);
  return grey
             ? ImageView(static_cast<const std::uint8_t*>(array.data()),
                         side(array, 1),
                         side(array, 0),
                         stride)
             : ImageView(
                   static_cast<const float*>(array.data()), side(array, 1), side(array, 0), stride);
}

RawImage rawView(const AnyArray& array, bool rgb) {
  RawImage image{array.data(), 0, 0, PixelFormat::kGrey8, 0};
  if (array.ndim() == 3 && array.shape(2) == 3 && array.dtype() == nb::dtype<std::uint8_t>()) {
    image.format = rgb ? PixelFormat::kRgb8 : PixelFormat::kBgr8;
  } else if (array.ndim() == 2 && array.dtype() == nb::dtype<std::uint16_t>()) {
    image.format = PixelFormat::kGrey16;
  } else if (array.ndim() != 2 || array.dtype() != nb::dtype<std::uint8_t>()) {
    throw std::invalid_argument(
        describe(array) +
        ": expected (height, width) of uint8 or uint16, or (height, width, 3) of uint8");
  }
  image.width = side(array, 1);
  image.height = side(array, 0);
  image.stride_bytes = rowBytes(array);
  return image;
}

Mask::Mask(const std::optional<AnyArray>& array) {
  if (!array) return;
  const bool flags = array->dtype() == nb::dtype<bool>();
  if (array->ndim() != 2 || (!flags && array->dtype() != nb::dtype<std::uint8_t>())) {
    throw std::invalid_argument(describe(*array) +
                                ": expected a mask, (height, width) of bool or uint8");
  }
  const std::size_t stride = rowBytes(*array);
  const auto* data = static_cast<const std::uint8_t*>(array->data());
  const int width = side(*array, 1);
  const int height = side(*array, 0);
  if (!flags) {
    view_ = ImageView(data, width, height, stride);
    return;
  }
  levels_.reserve(array->size());
  for (int y = 0; y < height; ++y) {
    const std::uint8_t* const row = data + static_cast<std::size_t>(y) * stride;
    for (int x = 0; x < width; ++x) levels_.push_back(row[x] != 0 ? 255 : 0);
  }
  view_ = ImageView(levels_.data(), width, height);
}

Matrix4 matrixOf(const SE3& pose) {
  const Eigen::Matrix<double, 4, 4, Eigen::RowMajor> matrix = pose.matrix();
  return arrayOf<Matrix4>(std::vector<double>(matrix.data(), matrix.data() + matrix.size()),
                          {4, 4});
}

std::optional<Matrix4> matrixOf(const std::optional<SE3>& pose) {
  if (!pose) return std::nullopt;
  return matrixOf(*pose);
}

std::optional<Covariance> covarianceOf(const std::optional<Matrix6d>& matrix) {
  if (!matrix) return std::nullopt;  // symmetric: columns are rows
  return arrayOf<Covariance>(std::vector<double>(matrix->data(), matrix->data() + matrix->size()),
                             {6, 6});
}

}  // namespace dsorb::python
