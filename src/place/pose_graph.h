// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/geometry/similarity.h"

#include <cstddef>
#include <vector>

namespace dsorb::place {

/// How one camera was seen to stand to another one.
struct GraphEdge {
  std::size_t i = 0;
  std::size_t j = 0;
  Similarity S_i_j;       ///< coordinates of camera j, in its unit, to those of camera i
  Matrix7d covariance;    ///< of a left increment of S_i_j
  bool doubtful = false;  ///< may be wrong altogether: counts by Cauchy's loss
};

/// Cameras that agree best with all edges; the first one stays.
/// @param S_world_cam by camera, each in its own unit; the start
/// @source Strasdat, Montiel, Davison, Scale Drift-Aware Large Scale Monocular SLAM, RSS 2010
[[nodiscard]] std::vector<Similarity> adjustGraph(const std::vector<Similarity>& S_world_cam,
                                                  const std::vector<GraphEdge>& edges,
                                                  int num_threads);

}  // namespace dsorb::place
