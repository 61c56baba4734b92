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
#include <optional>

/// The pattern of a point in its host and in another image, one lane a pixel.
namespace dsorb {

static_assert(kPatternSize == kLanes, "one lane a pixel of the pattern");

/// Offsets of kPattern [px].
constexpr Lanes kPatternX = {kPattern[0].x,
                             kPattern[1].x,
                             kPattern[2].x,
                             kPattern[3].x,
                             kPattern[4].x,
                             kPattern[5].x,
                             kPattern[6].x,
                             kPattern[7].x};
constexpr Lanes kPatternY = {kPattern[0].y,
                             kPattern[1].y,
                             kPattern[2].y,
                             kPattern[3].y,
                             kPattern[4].y,
                             kPattern[5].y,
                             kPattern[6].y,
                             kPattern[7].y};

/// The pattern of a point in the frame that hosts it, at some pyramid level.
struct HostPatch {
  Eigen::Vector2f ray{0, 0};                 ///< of its centre, at z = 1
  std::array<float, kPatternSize> grey{};    ///< [grey levels]
  std::array<float, kPatternSize> weight{};  ///< of each pixel's squared residual [-]
};

/// The same where rays follow the intrinsics, and weights are averaged with the target's.
struct HostPattern {
  std::array<float, kPatternSize> grey{};         ///< [grey levels]
  std::array<float, kPatternSize> root_weight{};  ///< root of gradientWeight() [-]
};

/// Reads the pattern around a pixel of the host.
/// @param structure if given, receives the sum of g g^T over the pattern (xx, xy, yy)
/// @return          nullopt where the pattern leaves the image or touches an invalid pixel
inline std::optional<HostPattern> readHostPattern(const PyramidLevel& level,
                                                  const Eigen::Vector2f& pixel,
                                                  Eigen::Vector3f* structure = nullptr) {
  if (!canSample(level, pixel.x(), pixel.y(), kPatternRadius)) return std::nullopt;
  HostPattern patch;
  for (std::size_t k = 0; k < kPattern.size(); ++k) {
    const Sample<float> sample =
        interpolateWithCellGradient(level,
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
  DSORB_ALWAYS_INLINE void at(const T& pixel_x, const T& pixel_y, T& ray_x, T& ray_y) const {
    ray_x = (pixel_x - cx) * inverse_fx;
    ray_y = (pixel_y - cy) * inverse_fy;
  }
};

/// A point of the host; the pixels of its pattern are taken to be as deep.
struct HostedPoint {
  float x, y;           ///< [px]
  float inverse_depth;  ///< [1/unit]
};

/// Projects the pattern of a point and samples the image there.
/// @return false unless all pixels are in front of the target and can be sampled
DSORB_ALWAYS_INLINE bool samplePattern(const TargetImage& target,
                                       const HostRays& rays,
                                       const HostedPoint& point,
                                       WarpedPoint<Lanes>& p,
                                       LaneSamples& samples) {
  Lanes ray_x;
  Lanes ray_y;
  rays.at<Lanes>(point.x + kPatternX, point.y + kPatternY, ray_x, ray_y);
  warpPoint(target.warp, ray_x, ray_y, point.inverse_depth, p);
  SampleArea<Lanes> area = {};
  MaskOf<Lanes> inside;
  sampleArea(target.width, target.height, area);
  sampleTarget(target, area, p, samples, inside);
  return inAllLanes(inside);
}

}  // namespace dsorb
