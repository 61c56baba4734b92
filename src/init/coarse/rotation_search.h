// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "init/coarse/coarse_alignment.h"

#include <vector>

namespace dsorb::init_coarse {

struct RotationMatch {
  Alignment rotation;
  bool matches = false;  ///< the images do, nearly everywhere in view: it may well be the motion
};

/// Finds the pure rotation that explains a frame best, on the coarsest level alone: from the best
/// of the given starts, or, where the images do not match from there, from a grid of rotations
/// around it.
class RotationSearch {
 public:
  explicit RotationSearch(const CoarseOptions& options) : aligner_(options) {}

  /// @param points coarsest level of the reference
  void setReference(const PointLevel& points) { points_ = points; }

  /// @param starts at least one; their translations are left out
  [[nodiscard]] RotationMatch find(const LevelView& coarsest, const std::vector<Alignment>& starts);

 private:
  /// Energy at an alignment; points out of view or far off count as outliers.
  double energy(const LevelView& view, const Alignment& alignment);
  Alignment best(const LevelView& view, const std::vector<Alignment>& candidates);
  /// @return share of the points in view that match
  double refine(const LevelView& view, Alignment& alignment);

  LevelAligner aligner_;
  PointLevel points_;
};

}  // namespace dsorb::init_coarse
