// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "estimate/target_image.h"
#include "estimate/triangle_sums.h"

#include <cstddef>
#include <limits>

namespace dsorb::track {

constexpr std::size_t kAlignmentBlock = 256;  ///< points summed in float before doubles take over
constexpr int kAlignmentParameters = 8;       ///< translation 3, rotation 3, brightness a and b
constexpr std::size_t kAlignmentSums = triangleSums(kAlignmentParameters);
constexpr int kRollingParameters = kAlignmentParameters + 6;  ///< and the velocity of the rows
constexpr std::size_t kRollingSums = triangleSums(kRollingParameters);

/// Constants of one evaluation, the same for all points.
struct AlignmentSetting {
  TargetImage target;        ///< level of the frame
  float affine_b_reference;  ///< [grey levels]
  float cutoff;              ///< [grey levels]
  /// Grey level at which the frame is clipped; infinite where it is not.
  float ceiling = std::numeric_limits<float>::infinity();
};

/// Reference points; arrays of the same length.
struct PointArrays {
  const float* ray_x;
  const float* ray_y;
  const float* inverse_depth;
  const float* intensity;
};

/// What an evaluation leaves for the normal equations, one value per point.
struct SampleArrays {
  float* u;         ///< normalised image coordinate in the frame
  float* v;         ///<
  float* rho;       ///< inverse depth in the frame [1/unit]
  float* dx;        ///< image gradient [grey levels / px]
  float* dy;        ///<
  float* residual;  ///< [grey levels]; 0 where the point is not used
  float* weight;    ///< Huber weight; 0 where the point is not used or saturated
  float* time;      ///< of the row that sees it, from the middle row; rolling shutter only [s]
};

struct BlockEnergy {
  float energy;   ///< Huber energy, saturated points at their bound
  int used;       ///< points inside the frame, saturated ones included
  int saturated;  ///< points with a residual above the cut-off
};

/// Residuals of `count` <= kAlignmentBlock points.
/// r = I_frame(p') - min(gain I_reference + offset, ceiling), p' the projection of the point.
BlockEnergy evaluateBlock(const AlignmentSetting& setting,
                          const PointArrays& points,
                          const SampleArrays& samples,
                          std::size_t count);

/// Weighted sums of products of Jacobians and residuals of `count` <= kAlignmentBlock points.
/// Jacobian of r by a left increment [translation; rotation] of the pose, then by a and b of the
/// frame: with (g_x, g_y) = (fx dI/dx, fy dI/dy), each product of these with the derivative of (u,
/// v).
void accumulateBlock(const AlignmentSetting& setting,
                     const PointArrays& points,
                     const SampleArrays& samples,
                     std::size_t count,
                     float* sums);
/// The same for a rolling shutter. Then come derivatives by the velocity of the rows: those by the
/// pose times the time of the row.
void accumulateRollingBlock(const AlignmentSetting& setting,
                            const PointArrays& points,
                            const SampleArrays& samples,
                            std::size_t count,
                            float* sums);

}  // namespace dsorb::track
