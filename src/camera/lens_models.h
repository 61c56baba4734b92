// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/calibration.h"

#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <cstddef>
#include <vector>

namespace dsorb {

/// Rays further out than this in x or y (z = 1) are never part of a rectified image; 157 degrees.
/// @source range of the crop search of DSO as published
inline constexpr double kMaxRay = 5;

/// A lens model as files and callers name it.
struct LensModelName {
  const char* name;
  LensModel model;
  std::size_t coefficients;       ///< of Lens::coefficients that it has
  const char* coefficient_names;  ///< in their order
};
inline constexpr std::array<LensModelName, 8> kLensModels = {
    {{"pinhole", LensModel::kPinhole, 0, ""},
     {"fov", LensModel::kFov, 1, "omega"},
     {"radtan", LensModel::kRadTan, 5, "k1 k2 p1 p2 k3"},
     {"equidistant", LensModel::kEquidistant, 4, "k1 k2 k3 k4"},
     {"rational", LensModel::kRational, 8, "k1 k2 p1 p2 k3 k4 k5 k6"},
     {"double_sphere", LensModel::kDoubleSphere, 2, "xi alpha"},
     {"eucm", LensModel::kExtendedUnified, 2, "alpha beta"},
     {"unified", LensModel::kUnified, 5, "xi k1 k2 p1 p2"}}};

[[nodiscard]] inline const LensModelName& nameOf(LensModel model) {
  return *std::find_if(kLensModels.begin(), kLensModels.end(), [model](const LensModelName& m) {
    return m.model == model;
  });
}

/// The coefficients that a lens' model has.
[[nodiscard]] inline std::vector<double> coefficientsOf(const Lens& lens) {
  const auto count = static_cast<std::ptrdiff_t>(nameOf(lens.model).coefficients);
  return {lens.coefficients.begin(), lens.coefficients.begin() + count};
}

/// Place of p1, behind which p2 stands, among the coefficients of a model; 0: it has none.
[[nodiscard]] inline std::size_t tangentialPlace(LensModel model) {
  if (model == LensModel::kRadTan || model == LensModel::kRational) return 2;
  return model == LensModel::kUnified ? 3 : 0;
}

/// Whether a lens maps rays otherwise than a pinhole of its numbers.
[[nodiscard]] bool isDistorted(const Lens& lens);

/// Pixel of the input image seen along the ray (x, y, 1).
/// @param ray [-]
/// @return pixel of the lens' image [px]; meaningful up to monotoneRadius()
/// @source FOV: Devernay and Faugeras 2001; radial-tangential: Brown 1971;
///         equidistant: Kannala and Brandt, PAMI 2006, eq. (6), in the form of OpenCV's fisheye;
///         rational: OpenCV's calib3d; double sphere and extended unified: Usenko et al., 3DV 2018,
///         eqs. (40) and (17); unified: Mei and Rives, ICRA 2007
[[nodiscard]] Eigen::Vector2d projectThroughLens(const Lens& lens, const Eigen::Vector2d& ray);

/// Largest |(x, y)| up to which the distortion is invertible: beyond it the polynomial folds back
/// and rays land on pixels that see something else.
/// @return [-], at most that of the corner (kMaxRay, kMaxRay)
[[nodiscard]] double monotoneRadius(const Lens& lens);

/// Ray that a pixel of the input image sees: inverse of projectThroughLens.
/// @param max_radius monotoneRadius(lens)
/// @return ray [-]; of length max_radius where the pixel lies beyond the invertible range
[[nodiscard]] Eigen::Vector2d rayOfPixel(const Lens& lens,
                                         const Eigen::Vector2d& pixel,
                                         double max_radius);

/// Axis-parallel rectangle of rays at z = 1.
struct RayRectangle {
  double x_min = 0;
  double x_max = 0;
  double y_min = 0;
  double y_max = 0;

  /// Camera whose outermost pixel centres lie on the rectangle; pixels need not be square.
  [[nodiscard]] PinholeCamera camera(int width, int height) const;
};

/// Largest rectangle of rays that all fall inside the input image: no edge can move outwards.
/// @param width, height samples per edge: the size of the rectified image [px]
/// @throws std::invalid_argument where there is none around the optical axis
[[nodiscard]] RayRectangle largestInscribedRectangle(const Lens& lens, int width, int height);

/// Smallest rectangle that holds the rays of all pixels, within kMaxRay.
[[nodiscard]] RayRectangle boundingRectangle(const Lens& lens);

}  // namespace dsorb
