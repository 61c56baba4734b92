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

/// A velocity of the system: what makes its relative gradients absolute ones, its first row.
struct VelocityState {
  Matrix6 to;
  Index row;
};

/// Adds the products of one velocity with all that is no velocity.
void addRows(const Rows& sums,
             const VelocityState& velocity,
             const PairGeometry& pair,
             const PairRows& rows,
             LinearSystem<float>& out) {
  const Eigen::Matrix<double, kPoseRows, kRowLanes> absolute = velocity.to * sums.cast<double>();
  const auto relative = absolute.leftCols<kFrameDim>();
  addBoth((relative * pair.to_host.transpose()).eval(), velocity.row, rows.host, out.H);
  addBoth((relative * pair.to_target.asDiagonal()).eval(), velocity.row, rows.target, out.H);
  addBoth(absolute.middleCols<kCameraDim>(kLaneCamera).eval(), velocity.row, 0, out.H);
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
  addRows(Eigen::Map<const Rows>(sums.by_host[0]), {host, of_host}, pair, rows, out);
  addRows(Eigen::Map<const Rows>(sums.by_target[0]), {target, of_target}, pair, rows, out);
  out.b.segment<kPoseRows>(of_host) += host * column(sums.host_residual);
  out.b.segment<kPoseRows>(of_target) += target * column(sums.target_residual);
  const Matrix6 hosts = host * symmetric(sums.host_host) * host.transpose();
  out.H.block<kPoseRows, kPoseRows>(of_host, of_host) += 0.5 * (hosts + hosts.transpose());
  out.H.block<kPoseRows, kPoseRows>(of_target, of_target) +=
      target * symmetric(sums.target_target) * target;
  addBoth((host * symmetric(sums.target_host) * target).eval(), of_host, of_target, out.H);
}

}  // namespace dsorb::window
