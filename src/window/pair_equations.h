// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "base/lanes.h"
#include "estimate/linear_system.h"
#include "window/pair_geometry.h"
#include "window/photometric_residual.h"

#include <Eigen/Core>

/// From sums over the residuals of an ordered pair of keyframes to the normal equations of the
/// absolute states.
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
