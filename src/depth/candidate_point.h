// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/pyramid.h"

#include "estimate/host_patch.h"

#include <Eigen/Core>

#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>

namespace dsorb::depth {

/// Answer of the last epipolar search.
enum class CandidateStatus : std::uint8_t {
  kUninitialized,
  kGood,
  kOutOfBounds,
  kOutlier,
  kSkipped,        ///< the interval is already short
  kIllConditioned  ///< a search could not shorten the interval
};

/// A pixel of a keyframe that waits for its depth.
struct CandidatePoint {
  float min_inverse_depth = 0;         ///< [1/unit]
  float max_inverse_depth = kUnknown;  ///< [1/unit], NaN before the first match
  float expected_min = 0;              ///< before the first match, by the points around [1/unit]
  float expected_max = kUnknown;       ///< [1/unit], NaN: nothing is expected
  float quality = 10000;               ///< second best over best energy
  float interval = 0;                  ///< uncertainty along the line [px]
  float selection_scale = 1;           ///< 1, 2 or 4: cell size of the pixel selector
  Eigen::Vector3f structure{0, 0, 0};  ///< sum of g g^T: xx, xy, yy
  CandidateStatus status = CandidateStatus::kUninitialized;
  bool finished = false;  ///< not searched any more
  HostPatch patch;        ///< level 0

  static constexpr float kUnknown = std::numeric_limits<float>::quiet_NaN();

  [[nodiscard]] bool hasDepth() const { return std::isfinite(max_inverse_depth); }
  [[nodiscard]] float middle() const { return 0.5F * (min_inverse_depth + max_inverse_depth); }
};

/// @param selection_scale 1, 2 or 4 as the pixel selector says
/// @return nullopt where readHostPatch has none
inline std::optional<CandidatePoint> makeCandidate(const PyramidLevel& level,
                                                   const Eigen::Vector2f& pixel,
                                                   float selection_scale) {
  CandidatePoint candidate;
  const auto patch = readHostPatch<interpolateWithCellGradient>(level, pixel, &candidate.structure);
  if (!patch) return std::nullopt;
  candidate.selection_scale = selection_scale;
  candidate.patch = *patch;
  return candidate;
}

}  // namespace dsorb::depth
