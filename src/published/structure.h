// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/init/report.h"
#include "dsorb/init/result.h"

#include <Eigen/Core>

#include <cstddef>
#include <cstdint>
#include <vector>

namespace dsorb::published {

/// Point hosted in the reference. Its pixel is exact because its patch was cut there.
struct MapPoint {
  Eigen::Vector2f pixel{0, 0};  ///< in the reference [px]
  double inverse_depth = 0;     ///< [1/unit]
  double variance = 0;          ///< [1/unit^2]; 0 until it is known
  int observations = 0;         ///< frames that see it
};

/// Place of a corner in a later frame.
struct Observation {
  std::size_t corner = 0;  ///< index into Map::points
  std::size_t frame = 0;   ///< index into Map::frames, at least 1
  Eigen::Vector2d pixel{0, 0};
};

/// The map of the thesis: frames since the reference, 3D points, and where corners were tracked.
struct Map {
  std::vector<PosedFrame> frames;         ///< all posed; the reference first: identity, a = b = 0
  std::vector<MapPoint> points;           ///< corners first, then those of epipolar search
  std::size_t corners = 0;                ///< number of them
  std::vector<Observation> observations;  ///< sorted by corner, then frame

  [[nodiscard]] const SE3& pose(std::size_t frame) const { return *frames[frame].T_cam_ref; }
  /// Poses of all frames but the reference.
  [[nodiscard]] std::vector<SE3> poses() const;
};

/// Removes marked points, corners with their observations. @param removed one a point
/// @return number of corners that went
int removePoints(Map& map, const std::vector<char>& removed);

/// Makes the mean inverse depth of the first points 1.
/// @return false when that mean is not positive; nothing is changed then
bool normalizeScale(Map& map, std::size_t count);

/// Sets the frames' brightness and the map's points after the corners: selects gradient pixels of
/// the reference, searches each along its epipolar line in every later frame by the sum of squared
/// differences over a patch, and fuses what is found to one inverse depth with variance. Runs in
/// parallel inside the caller's arena; the result does not depend on the number of threads.
/// @param map adjusted: poses, covariances, corners with variances; mean inverse depth 1
/// @param seed of the random choice among too many candidates
/// @source [Gladkova], section 3.3
void populateStructure3D(Map& map, const PinholeCamera& camera, std::uint64_t seed);

}  // namespace dsorb::published
