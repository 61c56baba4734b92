// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"

#include "init/orb/map/initial_map.h"
#include "init/orb/tracks/corner_tracks.h"

#include <cstddef>
#include <utility>
#include <vector>

namespace dsorb::init_orb {

/// How badly the best inverse depth explains each track under a map's poses: root mean square of
/// the reprojection error over the posed frames that see it, depth not behind the camera [px].
std::vector<double> trackErrors(const InitialMap& map,
                                const CornerTracks& tracks,
                                const PinholeCamera& camera);

/// The parts of the reference image whose tracks contradict the motion of the camera: what moves
/// by itself. One contradicting track may be an accident of tracking; a part is where its
/// neighbours contradict, too.
class MovingParts {
 public:
  /// @param map    adjusted poses
  /// @param tracks all of them, those that the map left out included
  MovingParts(const InitialMap& map, const CornerTracks& tracks, const PinholeCamera& camera);

  /// Tracks that contradict.
  [[nodiscard]] int contradicting() const { return contradicting_; }

  /// Takes the corners of these parts out of a map. @return their number
  int removeCorners(InitialMap& map) const;
  /// Takes the semi-dense points of these parts out of a map, and those that too few of their
  /// searches found: another depth fits in every frame. @return their number
  int removePoints(InitialMap& map) const;

 private:
  struct Vote {
    Eigen::Vector2f pixel;
    bool contradicts;
  };
  using Votes = std::vector<std::pair<float, bool>>;  // squared distance [px^2], contradicts

  /// Whether too many of the nearest tracks contradict. @param votes memory of the caller
  [[nodiscard]] bool cover(const Eigen::Vector2f& pixel, Votes& votes) const;
  /// @return by pixel of the reference, whether it is covered
  [[nodiscard]] std::vector<char> covered(const std::vector<Eigen::Vector2f>& pixels) const;
  [[nodiscard]] int cellOf(float coordinate, int cells) const;
  [[nodiscard]] std::size_t cellIndex(int column, int row) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) +
           static_cast<std::size_t>(column);
  }

  int columns_;
  int rows_;
  int contradicting_ = 0;
  std::vector<std::vector<Vote>> cells_;  // squares of the radius' side
};

}  // namespace dsorb::init_orb
