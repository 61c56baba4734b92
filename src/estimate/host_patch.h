// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/image/pyramid.h"

#include "base/lanes.h"
#include "estimate/target_image.h"
#include "image/photometric.h"

#include <Eigen/Core>

#include <array>
#include <cmath>
#include <cstddef>
#include <optional>

/// The pattern of a point in its host and in another image, one lane a pixel.
namespace dsorb {

static_assert(kPatternSize == kLanes, "one lane a pixel of the pattern");

/// Offsets of kPattern [px].
constexpr float patternX(std::size_t i) {
  return static_cast<float>(kPattern[i].x);
}
constexpr float patternY(std::size_t i) {
  return static_cast<float>(kPattern[i].y);
}
constexpr Lanes kPatternX = {patternX(0),
                             patternX(1),
                             patternX(2),
                             patternX(3),
                             patternX(4),
                             patternX(5),
                             patternX(6),
                             patternX(7)};
constexpr Lanes kPatternY = {patternY(0),
                             patternY(1),
                             patternY(2),
                             patternY(3),
                             patternY(4),
                             patternY(5),
                             patternY(6),
                             patternY(7)};

/// The pattern of a point in the frame that hosts it, at some pyramid level.
struct HostPatch {
  Eigen::Vector2f pixel{0, 0};                    ///< its centre at the time of the frame [px]
  Eigen::Vector2f seen{0, 0};                     ///< where the image shows it: its row's time [px]
  std::array<float, kPatternSize> grey{};         ///< [grey levels]
  std::array<float, kPatternSize> root_weight{};  ///< root of gradientWeight() [-]
};

/// Reads the pattern around a pixel of the host.
/// @tparam kGradient  which gradients weigh: interpolate or interpolateWithCellGradient
/// @param  structure  if given, receives the sum of g g^T over the pattern (xx, xy, yy)
/// @return            nullopt where the pattern leaves the image or touches an invalid pixel
template <Sample<float> (*kGradient)(const PyramidLevel&, float, float)>
std::optional<HostPatch> readHostPatch(const PyramidLevel& level,
                                       const Eigen::Vector2f& pixel,
                                       Eigen::Vector3f* structure = nullptr) {
  if (!canSample(level, pixel.x(), pixel.y(), kPatternRadius)) return std::nullopt;
  HostPatch patch;
  patch.pixel = pixel;
  patch.seen = pixel;
  for (std::size_t k = 0; k < kPattern.size(); ++k) {
    const Sample<float> sample = kGradient(level,
                                           pixel.x() + static_cast<float>(kPattern[k].x),
                                           pixel.y() + static_cast<float>(kPattern[k].y));
    if (!std::isfinite(sample.intensity)) return std::nullopt;
    patch.grey[k] = sample.intensity;
    patch.root_weight[k] = std::sqrt(gradientWeight(sample.dx * sample.dx + sample.dy * sample.dy));
    if (structure != nullptr) {
      *structure +=
          Eigen::Vector3f(sample.dx * sample.dx, sample.dx * sample.dy, sample.dy * sample.dy);
    }
  }
  return patch;
}

/// Pixels of the host to rays, z = 1.
struct HostRays {
  float inverse_fx, inverse_fy, cx, cy;

  explicit HostRays(const PinholeCamera& camera)
      : inverse_fx(static_cast<float>(1 / camera.fx)),
        inverse_fy(static_cast<float>(1 / camera.fy)),
        cx(static_cast<float>(camera.cx)),
        cy(static_cast<float>(camera.cy)) {}

  /// @tparam T float or Lanes
  template <typename T>
  [[nodiscard]] DSORB_ALWAYS_INLINE T x(const T& pixel) const {
    return (pixel - cx) * inverse_fx;
  }
  template <typename T>
  [[nodiscard]] DSORB_ALWAYS_INLINE T y(const T& pixel) const {
    return (pixel - cy) * inverse_fy;
  }
  [[nodiscard]] Eigen::Vector2f at(const Eigen::Vector2f& pixel) const {
    return {x(pixel.x()), y(pixel.y())};
  }
};

/// A pattern of the host in another image; all its pixels are taken to be as deep.
struct WarpedPattern {
  WarpedPoint<Lanes> at;
  LaneSamples seen;      ///< outside the image the nearest samples inside
  MaskOf<Lanes> inside;  ///< in front of the target and inside the image
};

/// @param pixel         centre of the pattern in the host [px]
/// @param inverse_depth [1/unit]
template <bool kRolling = false>
DSORB_ALWAYS_INLINE WarpedPattern warpPattern(const TargetImage& target,
                                              const HostRays& rays,
                                              const Eigen::Vector2f& pixel,
                                              float inverse_depth) {
  const auto ray_x = rays.x<Lanes>(pixel.x() + kPatternX);
  const auto ray_y = rays.y<Lanes>(pixel.y() + kPatternY);
  WarpedPattern pattern;
  pattern.at = projectInto<kRolling>(target, ray_x, ray_y, inverse_depth);
  pattern.seen = sampleTarget(target, pattern.at, pattern.inside);
  unbendGradients<kRolling>(target, pattern.at, pattern.seen);
  return pattern;
}

/// What it shows less what the host lets expect, I - (gain I_host + offset) [grey levels].
DSORB_ALWAYS_INLINE Lanes patternResidual(const TargetImage& target,
                                          const HostPatch& host,
                                          const LaneSamples& seen) {
  return seen.intensity - (target.gain * load(host.grey.data()) + target.offset);
}

}  // namespace dsorb
