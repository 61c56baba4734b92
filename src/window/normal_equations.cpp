// SPDX-License-Identifier: BSD-3-Clause
#include "window/normal_equations.h"

#include "base/parallel.h"
#include "base/target_clones.h"
#include "window/chunk_linearization.h"

#include <Eigen/Cholesky>

namespace dsorb::window {
namespace {

using Eigen::Index;

constexpr std::size_t kChunk = 128;     // points of one part of the work
constexpr std::size_t kSchurTasks = 4;  // partial sums of the elimination
constexpr std::size_t kSchurBlock = 4;  // points eliminated together
constexpr std::size_t kMaxDimension = kCameraDim + kFrameDim * kMaxKeyframes;
constexpr double kPreconditionerOffset = 10;  // @source DSO as published

/// Adds v v^T / D of a range of points to the upper triangle of `sum` (row-major, dimension +
/// 1 columns; the last column takes v b_d / D).
DSORB_TARGET_CLONES
void eliminateRange(const NormalEquations& equations,
                    std::size_t begin,
                    std::size_t end,
                    double* sum) {
  const auto dimension = static_cast<std::size_t>(equations.coupling.cols());
  const std::size_t columns = dimension + 1;
  alignas(32) double rows[kSchurBlock][kMaxDimension + 1];
  double weights[kSchurBlock];
  for (std::size_t block = begin; block < end; block += kSchurBlock) {
    for (std::size_t k = 0; k < kSchurBlock; ++k) {
      const std::size_t point = block + k;
      const float curvature =
          point < end ? equations.depth_curvature[static_cast<Index>(point)] : 0.0F;
      weights[k] = curvature > 0 ? 1.0 / static_cast<double>(curvature) : 0.0;
      const float* row = equations.coupling.data() + (point < end ? point : begin) * dimension;
      for (std::size_t i = 0; i < dimension; ++i) rows[k][i] = static_cast<double>(row[i]);
      rows[k][dimension] =
          point < end ? static_cast<double>(equations.depth_gradient[static_cast<Index>(point)])
                      : 0.0;
    }
    for (std::size_t i = 0; i < dimension; ++i) {
      const double a0 = weights[0] * rows[0][i];
      const double a1 = weights[1] * rows[1][i];
      const double a2 = weights[2] * rows[2][i];
      const double a3 = weights[3] * rows[3][i];
      if (a0 == 0 && a1 == 0 && a2 == 0 && a3 == 0) continue;  // a frame none of them is seen in
      double* to = sum + i * columns;
      for (std::size_t j = i; j < columns; ++j) {
        to[j] += (a0 * rows[0][j] + a1 * rows[1][j]) + (a2 * rows[2][j] + a3 * rows[3][j]);
      }
    }
  }
}

/// Double-precision sums of one ordered pair over all chunks of its host.
struct PairBlocks {
  Matrix8d H = Matrix8d::Zero();
  Vector8d b = Vector8d::Zero();
  Eigen::Matrix<double, kFrameDim, kCameraDim> H_camera =
      Eigen::Matrix<double, kFrameDim, kCameraDim>::Zero();
  Eigen::Matrix4d camera = Eigen::Matrix4d::Zero();
  Vector4d b_camera = Vector4d::Zero();

  void add(const PairSums& sums) {
    using Row = Eigen::Map<const Eigen::Array<double, 1, kLanes>>;
    for (Index i = 0; i < kPoseRows; ++i) {
      const Eigen::Array<double, 1, kLanes> row = Row(sums.rows[i]);
      H.row(i) += row.head<kFrameDim>().matrix();
      b[i] += row[kLaneResidual];
      H_camera.row(i) += row.segment<kCameraDim>(kLaneCamera).matrix();
    }
    for (Index i = 0; i < kCameraDim; ++i) {
      const Eigen::Array<double, 1, kLanes> row = Row(sums.rows[kPoseRows + i]);
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
  /// Rounding makes the two triangles differ; the upper one counts.
  void makeSymmetric() {
    H = Matrix8d(H.selfadjointView<Eigen::Upper>());
    camera = Eigen::Matrix4d(camera.selfadjointView<Eigen::Upper>());
  }
};

/// Adds one pair to the system of absolute states.
void addPair(const PairBlocks& blocks,
             const PairGeometry& pair,
             Index host,
             Index target,
             NormalEquations& out) {
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
  out.H.block<8, 4>(host, 0) += host_camera;
  out.H.block<8, 4>(target, 0) += target_camera;
  out.H.block<4, 8>(0, host) += host_camera.transpose();
  out.H.block<4, 8>(0, target) += target_camera.transpose();
  out.H.topLeftCorner<4, 4>() += blocks.camera;
  out.b.head<4>() += blocks.b_camera;
}

}  // namespace

std::vector<PointRef> allPoints(const Window& window) {
  std::vector<PointRef> refs;
  refs.reserve(window.numPoints());
  for (std::uint32_t k = 0; k < window.keyframes.size(); ++k) {
    for (std::uint32_t p = 0; p < window.keyframes[k].points.size(); ++p) refs.push_back({k, p});
  }
  return refs;
}

void NormalEquationsBuilder::split(const std::vector<PointRef>& points) {
  chunks_.clear();
  for (std::size_t i = 0; i < points.size(); ++i) {
    const bool fresh = chunks_.empty() || chunks_.back().host != points[i].keyframe ||
                       chunks_.back().end - chunks_.back().begin == kChunk;
    if (fresh) chunks_.push_back({points[i].keyframe, i, i, 0, 0, 0});
    chunks_.back().end = i + 1;
  }
}

void NormalEquationsBuilder::stitch(const PairTable& pairs, NormalEquations& out) const {
  const std::size_t frames = pairs.size();
  for (std::size_t host = 0; host < frames; ++host) {
    for (std::size_t target = 0; target < frames; ++target) {
      if (host == target) continue;
      PairBlocks blocks;
      for (std::size_t c = 0; c < chunks_.size(); ++c) {
        if (chunks_[c].host == host) blocks.add(pair_sums_[c * frames + target]);
      }
      blocks.makeSymmetric();
      addPair(blocks,
              pairs.at(host, target),
              kCameraDim + kFrameDim * static_cast<Index>(host),
              kCameraDim + kFrameDim * static_cast<Index>(target),
              out);
    }
  }
}

void NormalEquationsBuilder::eliminateDepths(std::size_t grain, NormalEquations& out) {
  const auto dimension = static_cast<std::size_t>(out.coupling.cols());
  const auto points = static_cast<std::size_t>(out.coupling.rows());
  const std::size_t size = dimension * (dimension + 1);
  schur_sums_.assign(kSchurTasks * size, 0.0);
  forEachRange(kSchurTasks, grain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t task = begin; task < end; ++task) {
      eliminateRange(out,
                     task * points / kSchurTasks,
                     (task + 1) * points / kSchurTasks,
                     schur_sums_.data() + task * size);
    }
  });
  using Sums =
      Eigen::Map<const Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>;
  const auto n = static_cast<Index>(dimension);
  Eigen::MatrixXd total = Eigen::MatrixXd::Zero(n, n + 1);
  for (std::size_t task = 0; task < kSchurTasks; ++task) {
    total += Sums(schur_sums_.data() + task * size, n, n + 1);
  }
  out.H_schur = total.leftCols(n).selfadjointView<Eigen::Upper>();
  out.b_schur = total.col(n);
}

void NormalEquationsBuilder::build(Window& window,
                                   const PairTable& pairs,
                                   const std::vector<PointRef>& points,
                                   const LinearizeOptions& options,
                                   NormalEquations& out) {
  const Index dimension = window.dimension();
  const auto count = static_cast<Index>(points.size());
  split(points);
  pair_sums_.assign(chunks_.size() * pairs.size(), PairSums{});
  out.coupling.setZero(count, dimension);
  out.depth_curvature.resize(count);
  out.depth_gradient.resize(count);
  ChunkContext context{
      &window, &pairs, points.data(), &options, window.camera(), {}, nullptr, &out};
  for (const Keyframe& keyframe : window.keyframes) {
    context.frame_deviation.emplace_back(keyframe.state - keyframe.first);
  }
  forEachRange(chunks_.size(), options.chunks_per_task, [&](std::size_t begin, std::size_t end) {
    ChunkContext mine = context;
    for (std::size_t c = begin; c < end; ++c) {
      mine.sums = pair_sums_.data() + c * pairs.size();
      linearizeChunk(mine, chunks_[c]);
    }
  });
  out.energy = 0;
  out.depth_prior_energy = 0;
  out.used = 0;
  for (const Chunk& chunk : chunks_) {
    out.energy += chunk.energy;
    out.depth_prior_energy += chunk.depth_prior_energy;
    out.used += chunk.used;
  }
  out.H.setZero(dimension, dimension);
  out.b.setZero(dimension);
  stitch(pairs, out);
  eliminateDepths(options.chunks_per_task == 0 ? 0 : 1, out);
}

Eigen::VectorXd solvePreconditioned(const Eigen::MatrixXd& H, const Eigen::VectorXd& b) {
  const Eigen::VectorXd scale =
      (H.diagonal().array().abs() + kPreconditionerOffset).sqrt().inverse();
  const Eigen::MatrixXd scaled = scale.asDiagonal() * H * scale.asDiagonal();
  return scale.asDiagonal() * scaled.ldlt().solve(scale.asDiagonal() * b);
}

Eigen::VectorXd backSubstitute(const NormalEquations& equations,
                               const Eigen::VectorXd& frame_step,
                               double damping) {
  Eigen::VectorXd depth_step =
      -(equations.depth_gradient.cast<double>() + equations.coupling.cast<double>() * frame_step);
  for (Index i = 0; i < depth_step.size(); ++i) {
    const auto curvature = static_cast<double>(equations.depth_curvature[i]);
    depth_step[i] = curvature > 0 ? depth_step[i] / ((1 + damping) * curvature) : 0.0;
  }
  return depth_step;
}

}  // namespace dsorb::window
