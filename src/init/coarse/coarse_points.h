// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/pyramid.h"

#include "image/pixel_selector.h"

#include <cstddef>
#include <cstdint>
#include <vector>

namespace dsorb::init_coarse {

constexpr int kNeighbours = 10;       // nearest points of the level, the point itself among them
constexpr float kPixelOffset = 0.1F;  // [px]; points stand off the pixel centres
constexpr float kSmoothingWeight = 0.8F;     // of the neighbours' median
constexpr float kMinParentCurvature = 0.1F;  // a flatter parent hands nothing down
constexpr float kMinInverseDepth = 1e-3F;    // of what is aligned and handed over

/// Points of one pyramid level of the first frame, structure of arrays. "Trial" values belong to
/// the step under test and become accepted with it.
struct PointLevel {
  std::vector<float> x, y;       ///< [px of the level]
  std::vector<float> reference;  ///< intensities of the pattern, 8 a point
  std::vector<std::int32_t>
      neighbours;                    ///< kNeighbours a point, nearest first; -1: fewer there are
  std::vector<std::int32_t> parent;  ///< point of the next coarser level, -1: none

  std::vector<float> inverse_depth, trial_inverse_depth;  ///< [1/unit]
  std::vector<float> smoothed;                    ///< inverse depth after smoothing: the output
  std::vector<float> energy, trial_energy;        ///< photometric [grey levels^2]
  std::vector<float> curvature, trial_curvature;  ///< of the energy over the inverse depth, half
  std::vector<float> max_step;  ///< inverse depth change that moves the projection by 1 px
  std::vector<std::uint8_t> good, trial_good;

  [[nodiscard]] int size() const { return static_cast<int>(x.size()); }
};

/// Points wanted on a level of an image of width x height at level 0; on coarse levels more than
/// there are pixels, which means all that have some gradient.
[[nodiscard]] int wantedPoints(int level, int width, int height);

/// A level of good points at inverse depth 1, with neighbours and without parents. Pixels too near
/// to the border and those whose pattern touches an invalid pixel are left out.
[[nodiscard]] PointLevel makePointLevel(const PyramidLevel& image,
                                        const std::vector<SelectedPixel>& pixels);

/// Sets each fine point's parent: the nearest coarse point, unless it is too far.
/// @param max_distance [px of the coarse level]; 0: no limit
void findParents(const PointLevel& coarse, double max_distance, PointLevel& fine);

/// All points back to the fronto-parallel plane at inverse depth 1; flags stay.
void flatten(PointLevel& level);

/// Replaces the smoothed inverse depth of good points, in place and in index order, by a mean of
/// their own inverse depth and their good neighbours' median.
void smooth(PointLevel& level);

/// Standard deviation of the good neighbours' own inverse depths about the smoothed one of a point:
/// by about so much smoothing is wrong, where it reaches over an edge of depth. Robust; 0 without
/// enough neighbours.
[[nodiscard]] float neighbourSpread(const PointLevel& level, std::size_t point);

/// Hands inverse depths from a level to the next finer one. The caller smooths the fine level then.
void propagateDown(const PointLevel& coarse, PointLevel& fine);

/// Hands curvature-weighted means of inverse depths to the next coarser level. The caller smooths
/// the coarse level then.
/// @param keep_orphans coarse points without a good child keep their smoothed inverse depth instead
///                     of getting 0, which would leak into their neighbours' medians
void propagateUp(const PointLevel& fine, bool keep_orphans, PointLevel& coarse);

/// Makes bad points with at least one good neighbour good, at the mean of these neighbours.
void reviveFromNeighbours(PointLevel& level);

}  // namespace dsorb::init_coarse
