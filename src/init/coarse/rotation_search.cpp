// SPDX-License-Identifier: BSD-3-Clause
#include "init/coarse/rotation_search.h"

#include <algorithm>
#include <cmath>

namespace dsorb::init_coarse {
namespace {

constexpr int kIterations = 10;
constexpr double kMinMatchShare = 0.8;  // of the points in view, else the grid is searched
constexpr double kGridStep = 1.5;       // [px of the coarsest level], within the alignment's reach
constexpr int kGridRadius = 3;          // steps: 72 px of level 0 with five levels

std::vector<Alignment> gridAround(const Alignment& center, const PinholeCamera& camera) {
  std::vector<Alignment> grid;
  for (int i = -kGridRadius; i <= kGridRadius; ++i) {
    for (int j = -kGridRadius; j <= kGridRadius; ++j) {
      Vector6d turn = Vector6d::Zero();
      turn[3] = kGridStep * i / camera.fy;
      turn[4] = kGridStep * j / camera.fx;
      grid.push_back(center);
      grid.back().T_new_ref = SE3::exp(turn) * center.T_new_ref;
    }
  }
  return grid;
}

}  // namespace

double RotationSearch::energy(const LevelView& view, const Alignment& alignment) {
  std::fill(points_.good.begin(), points_.good.end(), std::uint8_t{1});
  return aligner_.evaluate(view, Unknowns::kRotation, points_, alignment)
      .sums.robustEnergy(points_.size());
}

Alignment RotationSearch::best(const LevelView& view, const std::vector<Alignment>& candidates) {
  double least = HUGE_VAL;
  Alignment result = candidates.front();
  for (const Alignment& candidate : candidates) {
    const double value = energy(view, candidate);
    if (value < least) {
      least = value;
      result = candidate;
    }
  }
  return result;
}

double RotationSearch::refine(const LevelView& view, Alignment& alignment) {
  std::fill(points_.good.begin(), points_.good.end(), std::uint8_t{1});
  return aligner_.align(view, kIterations, Unknowns::kRotation, points_, alignment).inlierShare();
}

RotationMatch RotationSearch::find(const LevelView& coarsest,
                                   const std::vector<Alignment>& starts) {
  std::vector<Alignment> candidates = starts;
  for (Alignment& candidate : candidates) {
    candidate.T_new_ref.setTranslation(Eigen::Vector3d::Zero());
    candidate.snapped = false;
  }
  const Alignment start = best(coarsest, candidates);
  Alignment near = start;
  if (refine(coarsest, near) >= kMinMatchShare) return {near, true};
  Alignment far = best(coarsest, gridAround(start, coarsest.camera));
  const bool matches = refine(coarsest, far) >= kMinMatchShare;
  return matches ? RotationMatch{far, true} : RotationMatch{best(coarsest, {near, far}), false};
}

}  // namespace dsorb::init_coarse
