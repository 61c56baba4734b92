// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/similarity.h"

#include "image/cell_grid.h"
#include "place/alignment.h"
#include "place/keyframe_store.h"

#include <cstddef>
#include <optional>
#include <vector>

namespace dsorb::place {

/// Cells of a view, by which it is said how much of it something covers.
[[nodiscard]] inline CellGrid viewCells(const PinholeCamera& camera) {
  return {camera.width, camera.height, 8, 6};
}

/// How much of what a view should show of a map it shows.
struct Evidence {
  int views = 0;          ///< that show the place by themselves
  int predicted = 0;      ///< points that should be seen
  int found = 0;          ///< of these, with a like corner where they should be
  double chance = 0;      ///< share that would be found anywhere in the same images
  double log_chance = 0;  ///< log10 of the probability to find so many by chance
  int cells = 0;          ///< of 48 over the image, that have found points; the best view

  /// Share that was found of what should be seen.
  [[nodiscard]] double share() const {
    return predicted > 0 ? static_cast<double>(found) / predicted : 0;
  }
};

/// Probability that so much is found where another place is seen.
[[nodiscard]] double wrongProbability(const Evidence& evidence);

/// A view as it is asked about.
struct Query {
  const View* view = nullptr;
  PinholeCamera camera;
  float radial = 0;
};

/// Where a view was taken.
struct Recognition {
  std::size_t keyframe = 0;  ///< the one it was recognized by
  SE3 T_view_world;          ///< in the world and unit of that keyframe's segment
  Matrix6d covariance;       ///< of exp(xi) * T_view_world
  Evidence evidence;
  std::vector<StoredPoint> points;    ///< of the map, found in the view
  std::vector<std::size_t> features;  ///< where each of them was found
};

/// Looks for a view among the points around a keyframe.
[[nodiscard]] std::optional<Recognition> recognize(const KeyframeStore& store,
                                                   const Query& query,
                                                   std::size_t keyframe);

/// Two stretches of keyframes that see one place.
struct Link {
  std::size_t from = 0;  ///< keyframe around which one stretch lies
  std::size_t to = 0;    ///< and the other
  Similarity S_to_from;  ///< coordinates of the world of `from` to those of the world of `to`
  Matrix7d covariance;   ///< of a left increment of it
  int matches = 0;       ///< that agree with it
  Evidence evidence;
  double wrong_probability = 1;  ///< that it is another place
};

/// Verifies a recognition of a keyframe by all keyframes around it, in both directions.
[[nodiscard]] std::optional<Link> link(const KeyframeStore& store,
                                       std::size_t from,
                                       const Recognition& recognition);

}  // namespace dsorb::place
