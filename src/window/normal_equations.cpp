// SPDX-License-Identifier: BSD-3-Clause
#include "window/normal_equations.h"

#include "base/parallel.h"
#include "base/target_clones.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <utility>

namespace dsorb::window {
namespace {

using Eigen::Index;

using CameraMatrix = Eigen::Matrix<double, kCameraDim, kCameraDim>;

constexpr std::size_t kChunk = 128;           // points of one part of the work
constexpr double kPreconditionerOffset = 10;  // @source DSO as published
constexpr float kMinDepthCurvature = 1e-10F;

/// Everything the evaluation of one chunk reads and writes.
struct ChunkContext {
  Window* window;
  const PairTable* pairs;
  const PointRef* refs;
  const LinearizeOptions* options;
  std::vector<Vector8d> frame_deviation;  // for frozen residuals
  PairSums* sums;                         // by target
  WindowEquations* out;
};

/// One residual in relative coordinates: rows of the products with the 2x2 patch block.
struct ResidualTerms {
  PatchSums patch;
  ResidualGeometry geometry;
  alignas(32) float x[kRowLanes] = {};  // patch block times geometry, brightness, residual
  alignas(32) float y[kRowLanes] = {};
};

DSORB_ALWAYS_INLINE void reduce(ResidualTerms& terms, std::size_t lanes) {
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

/// Extrapolates the residual to the first estimates: r - J d, d the deviation of the relative state
/// and of the camera.
DSORB_ALWAYS_INLINE void freeze(PatchSums& p,
                                const ResidualGeometry& g,
                                const Vector8d& relative,
                                const CameraVector& camera_state) {
  float dx = 0;
  float dy = 0;
  for (Index i = 0; i < kPoseRows; ++i) {
    const auto d = static_cast<float>(relative[i]);
    dx += g.x[i] * d;
    dy += g.y[i] * d;
  }
  for (std::size_t i = 0; i < kCameraDim; ++i) {
    const auto d = static_cast<float>(camera_state[static_cast<Index>(i)]);
    dx += g.x[kLaneCamera + i] * d;
    dy += g.y[kLaneCamera + i] * d;
  }
  const auto da = static_cast<float>(relative[6]);
  const auto db = static_cast<float>(relative[7]);
  p.xr -= p.xx * dx + p.xy * dy + p.xa * da + p.xb * db;
  p.yr -= p.xy * dx + p.yy * dy + p.ya * da + p.yb * db;
  p.ar -= p.xa * dx + p.ya * dy + p.aa * da + p.ab * db;
  p.br -= p.xb * dx + p.yb * dy + p.ab * da + p.bb * db;
}

DSORB_ALWAYS_INLINE void accumulate(const ResidualTerms& terms, bool camera, PairSums& sums) {
  const ResidualGeometry& g = terms.geometry;
  const std::size_t lanes = camera ? kRowLanes : kRowLanesWithoutCamera;
  alignas(32) double x[kRowLanes];
  alignas(32) double y[kRowLanes];
  for (std::size_t i = 0; i < kRowLanes; ++i) {
    x[i] = static_cast<double>(terms.x[i]);
    y[i] = static_cast<double>(terms.y[i]);
  }
  const auto add_row = [&](double* row, float gx, float gy) {
    const auto jx = static_cast<double>(gx);
    const auto jy = static_cast<double>(gy);
    for (std::size_t i = 0; i < lanes; ++i) row[i] += jx * x[i] + jy * y[i];
  };
  for (std::size_t row = 0; row < kPoseRows; ++row) add_row(sums.rows[row], g.x[row], g.y[row]);
  if (camera) {
    for (std::size_t row = 0; row < kCameraDim; ++row) {
      add_row(sums.rows[kPoseRows + row], g.x[kLaneCamera + row], g.y[kLaneCamera + row]);
    }
  }
  const PatchSums& p = terms.patch;
  sums.brightness[0] += static_cast<double>(p.aa);
  sums.brightness[1] += static_cast<double>(p.ab);
  sums.brightness[2] += static_cast<double>(p.bb);
  sums.brightness[3] += static_cast<double>(p.ar);
  sums.brightness[4] += static_cast<double>(p.br);
}

/// Adds one residual to the row of its point. @return its share of (D, b_d)
DSORB_ALWAYS_INLINE Eigen::Vector2f couple(const ResidualTerms& terms,
                                           const PairGeometry& pair,
                                           bool camera,
                                           float* row,
                                           std::pair<std::size_t, std::size_t> host_target) {
  const PatchSums& p = terms.patch;
  const float jx = terms.geometry.depth_x;
  const float jy = terms.geometry.depth_y;
  Vector8f relative;
  for (std::size_t i = 0; i < kFrameDim; ++i) {
    relative[static_cast<Index>(i)] = terms.x[i] * jx + terms.y[i] * jy;
  }
  float* host = row + kCameraDim + kFrameDim * host_target.first;
  float* target = row + kCameraDim + kFrameDim * host_target.second;
  for (Index k = 0; k < kPoseRows; ++k) {  // column by column; brightness is diagonal
    for (Index i = 0; i < kPoseRows; ++i) {
      host[i] += pair.to_host_single(i, k) * relative[k];
    }
  }
  for (Index i = kPoseRows; i < kFrameDim; ++i) {
    host[i] += pair.to_host_single(i, i) * relative[i];
  }
  for (Index i = 0; i < kFrameDim; ++i) target[i] += pair.to_target_single[i] * relative[i];
  if (camera) {
    for (std::size_t i = 0; i < kCameraDim; ++i) {
      row[i] += terms.x[kLaneCamera + i] * jx + terms.y[kLaneCamera + i] * jy;
    }
  }
  return {jx * (p.xx * jx + p.xy * jy) + jy * (p.xy * jx + p.yy * jy), jx * p.xr + jy * p.yr};
}

/// Evaluates one observation and sets its trial values. @return whether it enters the system
DSORB_ALWAYS_INLINE bool evaluate(const WindowPoint& point,
                                  const ChunkContext& context,
                                  std::size_t host,
                                  Observation& observation,
                                  ResidualTerms& terms) {
  const Keyframe& target = context.window->keyframes[observation.target];
  const PairGeometry& pair = context.pairs->at(host, observation.target);
  observation.trial_state = ResidualState::kOutOfBounds;
  observation.trial_energy = observation.energy;
  if (observation.state == ResidualState::kOutOfBounds) return false;
  const bool seen =
      evaluatePatch(point, context.pairs->rays(), pair, terms.patch) &&
      evaluateGeometry(point, context.pairs->rays(), pair, context.options->camera, terms.geometry);
  if (!seen) return false;
  const float limit =
      std::max(context.window->keyframes[host].energy_threshold, target.energy_threshold);
  observation.trial_raw = terms.patch.energy;
  if (terms.patch.energy > limit || terms.patch.texture < kMinTexture) {
    observation.trial_state = ResidualState::kOutlier;
    observation.trial_energy = limit;
    return false;
  }
  observation.trial_state = ResidualState::kIn;
  observation.trial_energy = terms.patch.energy;
  return true;
}

/// Sums over the residuals of one point.
struct ResidualSums {
  float curvature = 0;
  float gradient = 0;
  int used = 0;
};

DSORB_ALWAYS_INLINE ResidualSums linearizePoint(WindowPoint& point,
                                                const ChunkContext& context,
                                                float* row,
                                                Chunk& chunk) {
  const bool camera = context.options->camera.any();
  ResidualTerms terms;
  ResidualSums sum;
  for (Observation& observation : point) {
    const bool used = evaluate(point, context, chunk.host, observation, terms);
    chunk.energy += static_cast<double>(observation.trial_energy);
    if (!used) continue;
    const std::size_t target = observation.target;
    const PairGeometry& pair = context.pairs->at(chunk.host, target);
    if (context.options->frozen) {
      const Vector8d relative = pair.to_host.transpose() * context.frame_deviation[chunk.host] +
                                pair.to_target.cwiseProduct(context.frame_deviation[target]);
      freeze(terms.patch, terms.geometry, relative, context.window->camera_state);
    }
    reduce(terms, camera ? kRowLanes : kRowLanesWithoutCamera);
    accumulate(terms, camera, context.sums[target]);
    const Eigen::Vector2f depth = couple(terms, pair, camera, row, {chunk.host, target});
    sum.curvature += depth[0];
    sum.gradient += depth[1];
    ++sum.used;
  }
  return sum;
}

DSORB_ALWAYS_INLINE void prefetchPoint(const WindowPoint& point,
                                       const ChunkContext& context,
                                       const Chunk& chunk) {
  for (const Observation& observation : point) {
    prefetchPatch(point, context.pairs->rays(), context.pairs->at(chunk.host, observation.target));
  }
}

/// Evaluates the residuals of a chunk: trial values of its observations, rows of its points, sums
/// of its pairs. Chunks write to disjoint places.
DSORB_TARGET_CLONES
void linearizeChunk(const ChunkContext& context, Chunk& chunk) {
  WindowEquations& out = *context.out;
  Keyframe& host = context.window->keyframes[chunk.host];
  const auto factor = static_cast<float>(context.options->depth_prior_factor);
  const float pull = context.options->depth_prior_pulls ? 1.0F : 0.0F;
  for (std::size_t i = chunk.begin; i < chunk.end; ++i) {
    WindowPoint& point = host.points[context.refs[i].point];
    if (i + 1 < chunk.end) prefetchPoint(host.points[context.refs[i + 1].point], context, chunk);
    float* row = out.coupling.data() + i * out.stride;
    std::fill_n(row, out.stride, 0.0F);
    const ResidualSums depth = linearizePoint(point, context, row, chunk);
    const float prior = factor * point.prior_information;
    const float deviation = pull * (point.inverse_depth - point.prior_inverse_depth);
    chunk.depth_prior_energy += static_cast<double>(prior * deviation * deviation);
    chunk.used += depth.used;
    const bool any = depth.used > 0;
    out.depth_hessian[i] = any ? std::max(depth.curvature + prior, kMinDepthCurvature) : 0;
    out.depth_gradient[i] = any ? depth.gradient + prior * deviation : 0;
  }
}

/// Double-precision sums of one ordered pair over all chunks of its host.
struct PairBlocks {
  Matrix8d H = Matrix8d::Zero();
  Vector8d b = Vector8d::Zero();
  Eigen::Matrix<double, kFrameDim, kCameraDim> H_camera =
      Eigen::Matrix<double, kFrameDim, kCameraDim>::Zero();
  CameraMatrix camera = CameraMatrix::Zero();
  CameraVector b_camera = CameraVector::Zero();

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
    camera = CameraMatrix(camera.selfadjointView<Eigen::Upper>());
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
  out.H.block<kFrameDim, kCameraDim>(host, 0) += host_camera;
  out.H.block<kFrameDim, kCameraDim>(target, 0) += target_camera;
  out.H.block<kCameraDim, kFrameDim>(0, host) += host_camera.transpose();
  out.H.block<kCameraDim, kFrameDim>(0, target) += target_camera.transpose();
  out.H.topLeftCorner<kCameraDim, kCameraDim>() += blocks.camera;
  out.b.head<kCameraDim>() += blocks.b_camera;
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

void evaluateNewest(Window& window,
                    const PairTable& pairs,
                    const std::vector<PointRef>& points,
                    std::size_t chunks_per_task) {
  const std::size_t newest = window.keyframes.size() - 1;
  const auto evaluate_one = [&](const PointRef& ref) {
    WindowPoint& point = window.keyframes[ref.keyframe].points[ref.point];
    for (Observation& observation : point) {
      if (observation.target != newest || observation.state == ResidualState::kOutOfBounds)
        continue;
      PatchSums patch;
      const bool seen = evaluatePatch(point, pairs.rays(), pairs.at(ref.keyframe, newest), patch);
      observation.trial_state = seen ? ResidualState::kIn : ResidualState::kOutOfBounds;
      if (seen) observation.trial_raw = patch.energy;
    }
  };
  forEachRange(points.size(), kChunk * chunks_per_task, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) evaluate_one(points[i]);
  });
}

Eigen::VectorXd solvePreconditioned(const Eigen::MatrixXd& H, const Eigen::VectorXd& b) {
  const Eigen::VectorXd scale =
      (H.diagonal().array().abs() + kPreconditionerOffset).sqrt().inverse();
  const Eigen::MatrixXd scaled = scale.asDiagonal() * H * scale.asDiagonal();
  return scale.asDiagonal() * scaled.ldlt().solve(scale.asDiagonal() * b);
}

}  // namespace dsorb::window
