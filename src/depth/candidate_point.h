// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/pyramid.h"

#include "estimate/sampling.h"
#include "image/photometric.h"

#include <Eigen/Core>

#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>

namespace dsorb::depth {

/// What residuals need of the host image, kept with the point: intensities of the pattern and the
/// square root of its gradient weights.
struct HostPatch {
  std::array<float, kPatternSize> intensity{};  ///< [grey levels]
  std::array<float, kPatternSize> weight{};     ///< [-], c / sqrt(c^2 + |gradient|^2)
};

/// Answer of the last epipolar search.
enum class SearchStatus : std::uint8_t {
  kUninitialized,
  kGood,
  kOutOfBounds,
  kOutlier,
  kSkipped,        ///< the interval is already short
  kIllConditioned  ///< a search could not shorten the interval
};

/// A pixel of a keyframe that waits for its depth.
struct CandidatePoint {
  Eigen::Vector2f pixel{0, 0};         ///< in the host, level 0 [px]
  float min_inverse_depth = 0;         ///< [1/unit]
  float max_inverse_depth = kUnknown;  ///< [1/unit], NaN before the first match
  float quality = 10000;               ///< second best over best energy
  float interval = 0;                  ///< uncertainty along the line [px]
  float selection_scale = 1;           ///< 1, 2 or 4: cell size of the pixel selector
  Eigen::Vector3f structure{0, 0, 0};  ///< sum of g g^T: xx, xy, yy
  SearchStatus status = SearchStatus::kUninitialized;
  bool finished = false;  ///< not searched any more
  HostPatch patch;

  static constexpr float kUnknown = std::numeric_limits<float>::quiet_NaN();

  [[nodiscard]] bool hasDepth() const { return std::isfinite(max_inverse_depth); }
  [[nodiscard]] float middle() const { return 0.5F * (min_inverse_depth + max_inverse_depth); }
};

/// Reads the pattern around a pixel of the host.
/// @param structure  if given, receives the sum of g g^T over the pattern (xx, xy, yy)
/// @return           nullopt where the pattern leaves the image or touches an invalid pixel
inline std::optional<HostPatch> readHostPatch(const PyramidLevel& level,
                                              const Eigen::Vector2f& pixel,
                                              Eigen::Vector3f* structure = nullptr) {
  if (!insideForInterpolation(level, pixel.x(), pixel.y(), kPatternRadius)) return std::nullopt;
  HostPatch patch;
  for (std::size_t k = 0; k < kPattern.size(); ++k) {
    const ImageSample sample =
        interpolateWithCellGradient(level,
                                    pixel.x() + static_cast<float>(kPattern[k].x),
                                    pixel.y() + static_cast<float>(kPattern[k].y));
    if (!std::isfinite(sample.intensity)) return std::nullopt;
    patch.intensity[k] = sample.intensity;
    patch.weight[k] = std::sqrt(gradientWeight(sample.dx * sample.dx + sample.dy * sample.dy));
    if (structure != nullptr) {
      *structure +=
          Eigen::Vector3f(sample.dx * sample.dx, sample.dx * sample.dy, sample.dy * sample.dy);
    }
  }
  return patch;
}

/// @param selection_scale 1, 2 or 4 as the pixel selector says
/// @return nullopt where readHostPatch has none
inline std::optional<CandidatePoint> makeCandidate(const PyramidLevel& level,
                                                   const Eigen::Vector2f& pixel,
                                                   float selection_scale) {
  CandidatePoint candidate;
  const std::optional<HostPatch> patch = readHostPatch(level, pixel, &candidate.structure);
  if (!patch) return std::nullopt;
  candidate.pixel = pixel;
  candidate.selection_scale = selection_scale;
  candidate.patch = *patch;
  return candidate;
}

}  // namespace dsorb::depth
