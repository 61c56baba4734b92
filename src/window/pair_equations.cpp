// SPDX-License-Identifier: BSD-3-Clause
#include "window/pair_equations.h"

namespace dsorb::window {

using Eigen::Index;

void PairBlocks::add(const PairSums& sums) {
  using Row = Eigen::Matrix<double, 1, kRowLanes>;
  const auto row_of = [&sums](Index i) -> Row {
    return Eigen::Map<const Eigen::Matrix<float, 1, kRowLanes>>(sums.rows[i]).cast<double>();
  };
  const auto single = [](float value) { return static_cast<double>(value); };
  for (Index i = 0; i < kPoseRows; ++i) {
    const Row row = row_of(i);
    H.row(i) += row.head<kFrameDim>();
    b[i] += single(sums.residual[i]);
    H_camera.row(i) += row.segment<kCameraDim>(kLaneCamera);
  }
  for (Index i = 0; i < kCameraDim; ++i) {
    const Row row = row_of(kPoseRows + i);
    H_camera(6, i) += row[kLaneA];
    H_camera(7, i) += row[kLaneB];
    b_camera[i] += row[kLaneResidual];
    camera.row(i) += row.segment<kCameraDim>(kLaneCamera);
  }
  H(6, 6) += single(sums.brightness[0]);
  H(6, 7) += single(sums.brightness[1]);
  H(7, 7) += single(sums.brightness[2]);
  b[6] += single(sums.brightness[3]);
  b[7] += single(sums.brightness[4]);
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
