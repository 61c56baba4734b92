// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"
#include "dsorb/image/affine_brightness.h"
#include "dsorb/image/pyramid.h"
#include "dsorb/options/depth.h"

#include "estimate/epipolar_geometry.h"
#include "estimate/host_patch.h"
#include "estimate/rolling_shutter.h"

#include <Eigen/Core>

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <vector>

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

/// Everything a search needs of a host and a posed frame; one for all candidates of the host.
struct EpipolarPair {
  EpipolarPair(const PinholeCamera& of_both,
               const SE3& T_frame_host,
               const BrightnessTransfer& transfer)
      : warp(makeWarp<float>(of_both, T_frame_host)),
        rays(of_both),
        geometry(of_both, T_frame_host),
        gain(static_cast<float>(transfer.gain)),
        offset(static_cast<float>(transfer.offset)) {}

  Warp<float> warp;
  HostRays rays;
  EpipolarGeometry geometry;
  float gain, offset;                       ///< brightness, host to frame
  std::optional<RollingShutter> shutter{};  ///< of the frame
};

/// Refines the inverse-depth interval of one candidate with one posed frame: discrete search along
/// the epipolar line, sub-pixel refinement, new interval from the expected error.
/// @param level  level 0 of the frame
/// @note         a match replaces the interval; intervals are not fused
/// @source       Engel et al., DSO, arXiv:1607.02565, section 3.2; error model: Engel et al.,
///               Semi-Dense Visual Odometry for a Monocular Camera, section 2.1
void searchEpipolarLine(CandidatePoint& candidate,
                        const EpipolarPair& pair,
                        const PyramidLevel& level,
                        const DepthOptions& options);

/// The same for all candidates of one host.
void searchEpipolarLines(std::vector<CandidatePoint>& candidates,
                         const EpipolarPair& pair,
                         const PyramidLevel& level,
                         const DepthOptions& options);

/// Distance of every cell to the nearest seed, grown in alternating steps to 8 and 4 neighbours so
/// that circles become octagons. Cells on the border are reached but not grown from.
class DistanceMap {
 public:
  static constexpr int kFar = 1000;  ///< cells no growth reached

  /// @param reach distances that are told apart [cells]; what is farther stays kFar
  DistanceMap(int width, int height, int reach);

  /// Adds seeds with distance 0 and grows from all of them together.
  /// @param seeds cells inside the map
  void add(const std::vector<Eigen::Vector2i>& seeds);
  [[nodiscard]] int at(int x, int y) const { return cells_[index(x, y)]; }
  [[nodiscard]] int width() const { return width_; }
  [[nodiscard]] int height() const { return height_; }

 private:
  struct Cell {
    std::int32_t index;
    std::int32_t x, y;
  };
  /// Cells that a step has reached: each at most once, so that there is room for all of them.
  struct Front {
    std::unique_ptr<Cell[]> cells;
    std::size_t size = 0;
  };
  [[nodiscard]] std::size_t index(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(width_) +
           static_cast<std::size_t>(x);
  }
  void growStep(int distance);

  int width_;
  int height_;
  int reach_;
  std::vector<std::uint16_t> cells_;
  Front front_;
  Front next_;
};

/// Next minimum distance between points, so that their number approaches the desired one.
/// @param distance  current, half-resolution pixels
/// @return          within [0, max_distance]
[[nodiscard]] double adaptDistance(double distance, int active, int desired, double max_distance);

enum class CandidateVerdict { kWait, kDrop, kReady };

/// Whether a candidate's depth is good enough to enter the window.
/// @param host_leaves  its keyframe is about to be marginalised
[[nodiscard]] CandidateVerdict judgeCandidate(const CandidatePoint& candidate, bool host_leaves);

struct DepthFit {
  CandidateVerdict verdict = CandidateVerdict::kDrop;  ///< the members below are valid for kReady
  float inverse_depth = 0;                             ///< [1/unit]
  float information = 0;                               ///< [grey levels^2 unit^2]
  std::vector<bool> seen;                              ///< by target: the residual is an inlier
};

/// Inverse depth of one candidate from all keyframes that see it, poses fixed: damped Gauss-Newton
/// on the photometric energy of the pattern.
/// @param rays    of the host
/// @param targets level 0 of each keyframe
/// @source Engel et al., DSO, arXiv:1607.02565, section 3.2 (activation)
[[nodiscard]] DepthFit fitDepth(const CandidatePoint& candidate,
                                const HostRays& rays,
                                const std::vector<TargetImage>& targets,
                                const DepthOptions& options);

}  // namespace dsorb::depth
