// SPDX-License-Identifier: BSD-3-Clause
#include "window/velocity_equations.h"

namespace dsorb::window {
namespace {

using Eigen::Index;
using Rows = Eigen::Matrix<float, kPoseRows, kRowLanes, Eigen::RowMajor>;
using Square = Eigen::Matrix<float, kPoseRows, kPoseLanes, Eigen::RowMajor>;
using Matrix6 = Eigen::Matrix<double, kPoseRows, kPoseRows>;

template <typename Block>
void addBoth(const Block& block, Index row, Index column, Eigen::MatrixXd& H) {
  H.block(row, column, block.rows(), block.cols()) += block;
  H.block(column, row, block.cols(), block.rows()) += block.transpose();
}

/// Adds the products of one velocity, whose relative gradients `to` makes absolute ones, with all
/// that is no velocity.
void addRows(const Rows& sums,
             const Matrix6& to,
             const PairGeometry& pair,
             const PairRows& rows,
             Index velocity,
             LinearSystem<float>& out) {
  const Eigen::Matrix<double, kPoseRows, kRowLanes> absolute = to * sums.cast<double>();
  const auto relative = absolute.leftCols<kFrameDim>();
  addBoth((relative * pair.to_host.transpose()).eval(), velocity, rows.host, out.H);
  addBoth((relative * pair.to_target.asDiagonal()).eval(), velocity, rows.target, out.H);
  addBoth(absolute.middleCols<kCameraDim>(kLaneCamera).eval(), velocity, 0, out.H);
}

Eigen::Matrix<double, kPoseRows, 1> column(const float (&sums)[kPoseLanes]) {
  return Eigen::Map<const Eigen::Matrix<float, kPoseRows, 1>>(sums).cast<double>();
}

/// Rounding makes the two triangles differ; the upper one counts.
Matrix6 symmetric(const float (&sums)[kPoseRows][kPoseLanes]) {
  const Matrix6 square = Eigen::Map<const Square>(sums[0]).leftCols<kPoseRows>().cast<double>();
  return square.selfadjointView<Eigen::Upper>();
}

}  // namespace

void addVelocities(const VelocitySums& sums,
                   const PairGeometry& pair,
                   const PairRows& rows,
                   LinearSystem<float>& out) {
  const Matrix6 host = pair.to_host.topLeftCorner<kPoseRows, kPoseRows>();
  const Matrix6 target = pair.to_target.head<kPoseRows>().asDiagonal();
  const Index of_host = rows.host + kFrameDim;
  const Index of_target = rows.target + kFrameDim;
  addRows(Eigen::Map<const Rows>(sums.by_host[0]), host, pair, rows, of_host, out);
  addRows(Eigen::Map<const Rows>(sums.by_target[0]), target, pair, rows, of_target, out);
  out.b.segment<kPoseRows>(of_host) += host * column(sums.host_residual);
  out.b.segment<kPoseRows>(of_target) += target * column(sums.target_residual);
  const Matrix6 hosts = host * symmetric(sums.host_host) * host.transpose();
  out.H.block<kPoseRows, kPoseRows>(of_host, of_host) += 0.5 * (hosts + hosts.transpose());
  out.H.block<kPoseRows, kPoseRows>(of_target, of_target) +=
      target * symmetric(sums.target_target) * target;
  addBoth((host * symmetric(sums.target_host) * target).eval(), of_host, of_target, out.H);
}

}  // namespace dsorb::window
