// SPDX-License-Identifier: BSD-3-Clause
#include "window/pair_equations.h"

namespace dsorb::window {

using Eigen::Index;

void PairBlocks::add(const PairSums& sums) {
  using Row = Eigen::Map<const Eigen::Array<double, 1, kRowLanes>>;
  for (Index i = 0; i < kPoseRows; ++i) {
    const Eigen::Array<double, 1, kRowLanes> row = Row(sums.rows[i]);
    H.row(i) += row.head<kFrameDim>().matrix();
    b[i] += row[kLaneResidual];
    H_camera.row(i) += row.segment<kCameraDim>(kLaneCamera).matrix();
  }
  for (Index i = 0; i < kCameraDim; ++i) {
    const Eigen::Array<double, 1, kRowLanes> row = Row(sums.rows[kPoseRows + i]);
    H_camera(6, i) += row[kLaneA];
    H_camera(7, i) += row[kLaneB];
    b_camera[i] += row[kLaneResidual];
    camera.row(i) += row.segment<kCameraDim>(kLaneCamera).matrix();
  }
  H(6, 6) += sums.brightness[0];
  H(6, 7) += sums.brightness[1];
  H(7, 7) += sums.brightness[2];
  b[6] += sums.brightness[3];
  b[7] += sums.brightness[4];
}

void addPair(const PairBlocks& blocks,
             const PairGeometry& pair,
             const PairRows& rows,
             LinearSystem<float>& out) {
  const auto [host, target] = rows;
  const Matrix8d host_H = pair.to_host * blocks.H;
  const auto to_target = pair.to_target.asDiagonal();
  const Matrix8d host_block = host_H * pair.to_host.transpose();
  out.H.block<8, 8>(host, host) += 0.5 * (host_block + host_block.transpose());
  out.H.block<8, 8>(target, target) += to_target * blocks.H * to_target;
  const Matrix8d cross = host_H * to_target;
  out.H.block<8, 8>(host, target) += cross;
  out.H.block<8, 8>(target, host) += cross.transpose();
  out.b.segment<8>(host) += pair.to_host * blocks.b;
  out.b.segment<8>(target) += to_target * blocks.b;
  const Eigen::Matrix<double, kFrameDim, kCameraDim> host_camera = pair.to_host * blocks.H_camera;
  const Eigen::Matrix<double, kFrameDim, kCameraDim> target_camera = to_target * blocks.H_camera;
  out.H.block<kFrameDim, kCameraDim>(host, 0) += host_camera;
  out.H.block<kFrameDim, kCameraDim>(target, 0) += target_camera;
  out.H.block<kCameraDim, kFrameDim>(0, host) += host_camera.transpose();
  out.H.block<kCameraDim, kFrameDim>(0, target) += target_camera.transpose();
  out.H.topLeftCorner<kCameraDim, kCameraDim>() += blocks.camera;
  out.b.head<kCameraDim>() += blocks.b_camera;
}

}  // namespace dsorb::window
