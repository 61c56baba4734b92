// SPDX-License-Identifier: BSD-3-Clause
#include "window/normal_equations.h"

#include "base/parallel.h"
#include "window/chunk_linearization.h"

#include <Eigen/Cholesky>

namespace dsorb::window {
namespace {

using Eigen::Index;

constexpr std::size_t kChunk = 128;           // points of one part of the work
constexpr double kPreconditionerOffset = 10;  // @source DSO as published

/// Double-precision sums of one ordered pair over all chunks of its host.
struct PairBlocks {
  Matrix8d H = Matrix8d::Zero();
  Vector8d b = Vector8d::Zero();
  Eigen::Matrix<double, kFrameDim, kCameraDim> H_camera =
      Eigen::Matrix<double, kFrameDim, kCameraDim>::Zero();
  Eigen::Matrix4d camera = Eigen::Matrix4d::Zero();
  Vector4d b_camera = Vector4d::Zero();

  void add(const PairSums& sums) {
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
             WindowEquations& out) {
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

void NormalEquationsBuilder::stitch(const PairTable& pairs, WindowEquations& out) const {
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

void NormalEquationsBuilder::build(Window& window,
                                   const PairTable& pairs,
                                   const std::vector<PointRef>& points,
                                   const LinearizeOptions& options,
                                   WindowEquations& out) {
  split(points);
  pair_sums_.assign(chunks_.size() * pairs.size(), PairSums{});
  out.reset(window.dimension(), points.size());
  ChunkContext context{&window, &pairs, points.data(), &options, {}, nullptr, &out};
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
  stitch(pairs, out);
}

Eigen::VectorXd solvePreconditioned(const Eigen::MatrixXd& H, const Eigen::VectorXd& b) {
  const Eigen::VectorXd scale =
      (H.diagonal().array().abs() + kPreconditionerOffset).sqrt().inverse();
  const Eigen::MatrixXd scaled = scale.asDiagonal() * H * scale.asDiagonal();
  return scale.asDiagonal() * scaled.ldlt().solve(scale.asDiagonal() * b);
}

}  // namespace dsorb::window
