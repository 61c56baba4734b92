// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "base/lanes.h"
#include "estimate/linear_system.h"
#include "window/pair_geometry.h"
#include "window/photometric_residual.h"

#include <Eigen/Core>

/// The way from sums over the residuals of an ordered pair of keyframes to the normal equations of
/// the absolute states.
namespace dsorb::window {

/// Sums of one ordered pair over one chunk: rows of the relative normal equations (translation,
/// rotation, camera; lanes as in photometric_residual.h) and the brightness block.
struct PairSums {
  alignas(32) float rows[kPoseRows + kCameraDim][kRowLanes];
  float residual[kPoseLanes];  // column of the residual in the rows of the pose
  float brightness[5];         // aa, ab, bb, ar, br
};

/// Products of the residual with the rows of the pose.
/// @param x, y the patch block times geometry, brightness, residual: kRowLanes of them
DSORB_ALWAYS_INLINE void residualColumn(const ResidualGeometry& g,
                                        const float* x,
                                        const float* y,
                                        Lanes& column) {
  Lanes by_x;
  Lanes by_y;
  load(g.x, by_x);
  load(g.y, by_y);
  column = x[kLaneResidual] * by_x + y[kLaneResidual] * by_y;
}

/// One residual in relative coordinates: rows of the products with the 2x2 patch block.
struct ResidualTerms {
  PatchSums patch;
  ResidualGeometry geometry;
  alignas(32) float x[kRowLanes] = {};  // patch block times geometry, brightness, residual
  alignas(32) float y[kRowLanes] = {};
};

DSORB_ALWAYS_INLINE void sumLanes(ResidualTerms& terms, std::size_t lanes) {
  const PatchSums& p = terms.patch;
  const ResidualGeometry& g = terms.geometry;
  for (std::size_t i = 0; i < lanes; ++i) {
    terms.x[i] = p.xx * g.x[i] + p.xy * g.y[i];
    terms.y[i] = p.xy * g.x[i] + p.yy * g.y[i];
  }
  terms.x[kLaneA] = p.xa;
  terms.x[kLaneB] = p.xb;
  terms.x[kLaneResidual] = p.xr;
  terms.y[kLaneA] = p.ya;
  terms.y[kLaneB] = p.yb;
  terms.y[kLaneResidual] = p.yr;
}

/// The camera's columns in the rows of the pose, and its rows.
DSORB_ALWAYS_INLINE void accumulateCamera(const ResidualTerms& terms, PairSums& sums) {
  const ResidualGeometry& g = terms.geometry;
  Lanes x;
  Lanes y;
  Lanes rest_x;
  Lanes rest_y;
  load(terms.x, x);
  load(terms.y, y);
  load(terms.x + kLanes, rest_x);
  load(terms.y + kLanes, rest_y);
  for (std::size_t row = 0; row < kPoseRows; ++row) {
    addLanes(g.x[row] * rest_x + g.y[row] * rest_y, sums.rows[row] + kLanes);
  }
  for (std::size_t i = 0; i < kCameraDim; ++i) {
    const float jx = g.x[kLaneCamera + i];
    const float jy = g.y[kLaneCamera + i];
    addLanes(jx * x + jy * y, sums.rows[kPoseRows + i]);
    addLanes(jx * rest_x + jy * rest_y, sums.rows[kPoseRows + i] + kLanes);
  }
}

/// Adds one residual. In single precision: a chunk is short, and chunks are added in double
/// precision.
/// @param camera whether something is estimated of it
DSORB_ALWAYS_INLINE void accumulate(const ResidualTerms& terms, bool camera, PairSums& sums) {
  const ResidualGeometry& g = terms.geometry;
  Lanes x;
  Lanes y;
  load(terms.x, x);
  load(terms.y, y);
  for (std::size_t row = 0; row < kPoseRows; ++row) {
    addLanes(g.x[row] * x + g.y[row] * y, sums.rows[row]);
  }
  Lanes residual;
  residualColumn(g, terms.x, terms.y, residual);
  addLanes(residual, sums.residual);
  if (camera) accumulateCamera(terms, sums);
  const PatchSums& p = terms.patch;
  sums.brightness[0] += p.aa;
  sums.brightness[1] += p.ab;
  sums.brightness[2] += p.bb;
  sums.brightness[3] += p.ar;
  sums.brightness[4] += p.br;
}

using CameraMatrix = Eigen::Matrix<double, kCameraDim, kCameraDim>;

/// Double-precision sums of one ordered pair over all chunks of its host.
struct PairBlocks {
  Matrix8d H = Matrix8d::Zero();
  Vector8d b = Vector8d::Zero();
  Eigen::Matrix<double, kFrameDim, kCameraDim> H_camera =
      Eigen::Matrix<double, kFrameDim, kCameraDim>::Zero();
  CameraMatrix camera = CameraMatrix::Zero();
  CameraVector b_camera = CameraVector::Zero();

  void add(const PairSums& sums);
  /// Rounding makes the two triangles differ; the upper one counts.
  void makeSymmetric() {
    H = Matrix8d(H.selfadjointView<Eigen::Upper>());
    camera = CameraMatrix(camera.selfadjointView<Eigen::Upper>());
  }
};

/// Places of a pair in the system: first row of the state of a keyframe.
struct PairRows {
  Eigen::Index host = 0;
  Eigen::Index target = 0;
};

/// Adds one pair to the system of absolute states.
void addPair(const PairBlocks& blocks,
             const PairGeometry& pair,
             const PairRows& rows,
             LinearSystem<float>& out);

}  // namespace dsorb::window
