// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"
#include "dsorb/image/pyramid.h"

#include "features/corner_tracks.h"
#include "image/cell_grid.h"
#include "init/orb/map/initial_map.h"

#include <Eigen/Core>

#include <cstdint>
#include <vector>

namespace dsorb::init_orb {

/// Leaves out the tracks on edges where most are on edges: bars, blinds, corrugated walls. Such a
/// track slides along its edge and knows one direction of its motion only; a few of them among
/// corners do no harm, but where they are most, they agree about motions that are wrong.
/// @param image that the tracks begin in
void leaveOutEdges(const PyramidLevel& image, CornerTracks& tracks);

/// Leaves out the tracks of what moves with the camera: a bonnet, a watermark, hot pixels. They
/// stand still in all frames, against the epipolar geometry of the others all over the image:
/// points far away, or those that the camera turns around, agree with it. Without this 36 instead
/// of 47 of 48 starts came behind a bonnet or a watermark.
/// @param seed of the samples by which the others' motion is found
/// @return where the reference shows those that were left out [px]
std::vector<Eigen::Vector2f> leaveOutStuck(CornerTracks& tracks,
                                           const PinholeCamera& camera,
                                           std::uint64_t seed);

/// Whether matches that a motion leaves out have a motion of their own and are more than those that
/// it explains, or neither far fewer nor far closer together: one of both is that of an object
/// before the world, and which one is not known.
/// @param seed of the samples by which the other motion is found
bool hasRival(const SE3& T_cur_ref,
              const Matches& matches,
              const PinholeCamera& camera,
              std::uint64_t seed);

/// How badly the best inverse depth explains each track under a map's poses: root mean square of
/// the reprojection error over the posed frames that see it, depth not behind the camera [px].
std::vector<double> trackErrors(const InitialMap& map,
                                const CornerTracks& tracks,
                                const PinholeCamera& camera);

/// The regions of the reference image whose tracks contradict the motion of the camera: what moves
/// by itself. One contradicting track may be an accident of tracking; in a region its neighbours
/// contradict, too.
class DynamicRegions {
 public:
  /// @param map    adjusted poses
  /// @param tracks all of them, those that the map left out included
  DynamicRegions(const InitialMap& map, const CornerTracks& tracks, const PinholeCamera& camera);

  /// Takes the corners and the other points of these regions out of a map.
  void removeFrom(InitialMap& map) const;

 private:
  /// @return by pixel of the reference, whether too many of the nearest tracks contradict
  [[nodiscard]] std::vector<char> covered(const std::vector<Eigen::Vector2f>& pixels) const;

  float radius_;                   ///< within which tracks vote [px]
  PointGrid grid_;                 ///< the tracks in the reference
  std::vector<char> contradicts_;  ///< by track
};

}  // namespace dsorb::init_orb
