// SPDX-License-Identifier: BSD-3-Clause
#include "window/chunk_linearization.h"

#include "base/target_clones.h"
#include "window/photometric_residual.h"

#include <algorithm>
#include <utility>

namespace dsorb::window {
namespace {

using Eigen::Index;

constexpr float kMinDepthCurvature = 1e-10F;

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
/// and of the intrinsics.
DSORB_ALWAYS_INLINE void freeze(PatchSums& p,
                                const ResidualGeometry& g,
                                const Vector8d& relative,
                                const Vector4d& camera_state) {
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
      evaluateGeometry(
          point, context.pairs->rays(), pair, context.options->intrinsics, terms.geometry);
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
  const bool camera = context.options->intrinsics;
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

}  // namespace

DSORB_TARGET_CLONES
void linearizeChunk(const ChunkContext& context, Chunk& chunk) {
  WindowEquations& out = *context.out;
  Keyframe& host = context.window->keyframes[chunk.host];
  const auto factor = static_cast<float>(context.options->depth_prior_factor);
  const float pull = context.options->depth_prior_pulls ? 1.0F : 0.0F;
  for (std::size_t i = chunk.begin; i < chunk.end; ++i) {
    WindowPoint& point = host.points[context.refs[i].point];
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

}  // namespace dsorb::window
