// SPDX-License-Identifier: BSD-3-Clause
#include "window/normal_equations.h"

#include "base/lanes.h"
#include "base/parallel.h"
#include "base/target_clones.h"
#include "estimate/robust_loss.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace dsorb::window {
namespace {

using Eigen::Index;

/// Derivatives of the target's pixel by the host's, times -1 [-].
struct RayJacobian {
  float xx, xy, yx, yy;
};

RayJacobian rayJacobian(const Warp<float>& warp, const WarpedPoint<float>& p) {
  const float* R = warp.R;
  const float fx_over_fy = warp.fx / warp.fy;
  return {(R[6] * p.u - R[0]) * p.inverse_z,
          fx_over_fy * (R[7] * p.u - R[1]) * p.inverse_z,
          (R[6] * p.v - R[3]) * p.inverse_z / fx_over_fy,
          (R[7] * p.v - R[4]) * p.inverse_z};
}

/// Shifts of a projected pixel by fx, fy, cx, cy and the radial distortion, for a ray that stays:
/// as shifts of the pixel of a pinhole camera.
std::array<Eigen::Vector2f, 5> lensShifts(const Eigen::Vector2f& ray,
                                          const Warp<float>& warp,
                                          float radial) {
  const Eigen::Vector2f focal(warp.fx, warp.fy);
  const float squared = ray.squaredNorm();
  const Eigen::Vector2f bent = ray * (1 + radial * squared);
  std::array<Eigen::Vector2f, 5> shifts{Eigen::Vector2f(bent.x() / warp.fx, 0),
                                        Eigen::Vector2f(0, bent.y() / warp.fy),
                                        Eigen::Vector2f(1 / warp.fx, 0),
                                        Eigen::Vector2f(0, 1 / warp.fy),
                                        ray * squared};
  for (Eigen::Vector2f& shift : shifts) {
    shift = focal.cwiseProduct(unbendShift(radial, ray, shift));
  }
  return shifts;
}

/// A lens enters twice: in the host's ray and in the target's projection.
void addLens(const Eigen::Vector2f& ray,
             const PairGeometry& pair,
             const WarpedPoint<float>& p,
             bool estimates_radial,
             ResidualGeometry& geometry) {
  const float radial = pair.current.shutter.radial;
  const RayJacobian by_ray = rayJacobian(pair.first, p);
  const auto host = lensShifts(ray, pair.first, radial);
  const auto target = lensShifts({p.u, p.v}, pair.first, radial);
  const auto add = [&](std::size_t i, std::size_t lane, double scale) {
    const auto factor = static_cast<float>(scale);
    geometry.x[lane] = factor * (target[i].x() + by_ray.xx * host[i].x() + by_ray.xy * host[i].y());
    geometry.y[lane] = factor * (target[i].y() + by_ray.yx * host[i].x() + by_ray.yy * host[i].y());
  };
  for (std::size_t i = 0; i < kIntrinsicsDim; ++i) add(i, kLaneCamera + i, kCameraScale);
  if (estimates_radial) add(kIntrinsicsDim, kLaneCamera + kRadial, kRadialScale);
}

/// Velocity of a point on the image plane z = 1 [1/s] at a time.
/// @param forth from the middle row to another; else back
Eigen::Vector2f velocityAt(
    const RollingShutter& shutter, const Eigen::Vector2f& ray, float rho, float time, bool forth) {
  const RowFlow<float> flow = rowFlow(shutter, {ray.x(), ray.y()}, rho, forth);
  const float sign = forth ? 1.0F : -1.0F;
  const float t = sign * time;
  const auto moved = [&](int i) { return t * (flow.first[i] + 0.5F * t * flow.second[i]); };
  const auto speed = [&](int i) { return flow.first[i] + t * flow.second[i]; };
  const float scale = 1.0F / (1.0F + moved(2));
  const Eigen::Vector2f at((ray.x() + moved(0)) * scale, (ray.y() + moved(1)) * scale);
  return sign * scale * (Eigen::Vector2f(speed(0), speed(1)) - at * speed(2));
}

/// The readout enters twice: in the pixel of the host's middle row and in the row of the target
/// that sees the point. Rows passed in a row's time are left out.
void addReadout(const WindowPoint& point,
                const HostRays& rays,
                const PairGeometry& pair,
                const WarpedPoint<float>& p,
                ResidualGeometry& geometry) {
  constexpr auto kScale = static_cast<float>(kReadoutScale);
  const Warp<float>& warp = pair.first;
  const Eigen::Vector2f& seen = point.patch.seen;
  const auto by_readout = [](const RollingShutter& shutter,
                             const Eigen::Vector2f& pixel,
                             const Eigen::Vector2f& ray,
                             float rho,
                             bool forth) -> Eigen::Vector2f {
    const float share = rowShare(shutter, pixel.x(), pixel.y());
    return share * velocityAt(shutter, ray, rho, shutter.readout * share, forth);
  };
  const Eigen::Vector2f host =
      by_readout(pair.host_shutter, seen, rays.at(seen), point.inverse_depth, false);
  const Eigen::Vector2f target = by_readout(
      pair.current.shutter, {p.x, p.y}, {p.u, p.v}, point.inverse_depth * p.inverse_z, true);
  const RayJacobian by_ray = rayJacobian(warp, p);
  const float moved_x = warp.fx * host.x();
  const float moved_y = warp.fy * host.y();
  geometry.x[kLaneReadout] =
      kScale * (warp.fx * target.x() - by_ray.xx * moved_x - by_ray.xy * moved_y);
  geometry.y[kLaneReadout] =
      kScale * (warp.fy * target.y() - by_ray.yx * moved_x - by_ray.yy * moved_y);
}

/// When the rows of the host and of the target are read that show the point. Derivatives need no
/// better time than that of the pixel moved on straight, at the speed of the middle row.
void addTimes(const WindowPoint& point,
              const PairGeometry& pair,
              const WarpedPoint<float>& p,
              ResidualGeometry& geometry) {
  const TargetImage& target = pair.current;
  const RowFlow<float> flow =
      rowFlow(target.shutter, {p.u, p.v}, point.inverse_depth * p.inverse_z, true);
  const float time = rowTime(target.shutter, p.x, p.y);
  const float* d = flow.first;
  const float x = p.x + time * target.warp.fx * (d[0] - p.u * d[2]);
  const float y = p.y + time * target.warp.fy * (d[1] - p.v * d[2]);
  const Eigen::Vector2f& seen = point.patch.seen;
  constexpr auto kScale = static_cast<float>(kVelocityScale);
  geometry.target_time = kScale * rowTime(target.shutter, x, y);
  geometry.host_time = kScale * rowTime(pair.host_shutter, seen.x(), seen.y());
}

/// The square of the mean of the roots of gradientWeight in host and target.
DSORB_ALWAYS_INLINE Lanes meanWeights(const Lanes& squared_gradient, const Lanes& host_root) {
  constexpr float kC = 50.0F;
  const Lanes mean = 0.5F * (kC / squareRoots(squared_gradient + kC * kC) + host_root);
  return mean * mean;
}

template <bool kRolling>
DSORB_ALWAYS_INLINE bool sumPatch(const WindowPoint& point,
                                  const HostRays& rays,
                                  const PairGeometry& pair,
                                  PatchSums& sums) {
  const WarpedPattern pattern =
      warpPattern<kRolling>(pair.current, rays, point.patch.pixel, point.inverse_depth);
  if (!inAllLanes(pattern.inside)) return false;
  const LaneSamples& seen = pattern.seen;
  const Lanes residual = patternResidual(pair.current, point.patch, seen);
  const Lanes squared_gradient = seen.dx * seen.dx + seen.dy * seen.dy;
  const Lanes huber = huberWeights(residual);
  const Lanes w = meanWeights(squared_gradient, load(point.patch.root_weight.data())) * huber;
  const Lanes wx = w * seen.dx;
  const Lanes wy = w * seen.dy;
  const Lanes wr = w * residual;
  const Lanes radiance = load(point.patch.grey.data()) - pair.host_offset_first;
  const Lanes wa = w * radiance;
  Lanes totals = sumLanes({huberEnergies(residual, huber, w),
                           w * w * squared_gradient,
                           wx * seen.dx,
                           wx * seen.dy,
                           wy * seen.dy,
                           wx * radiance,
                           wy * radiance,
                           wx});
  sums.energy = totals[0];
  if (!std::isfinite(sums.energy)) return false;
  sums.texture = totals[1];
  sums.xx = totals[2];
  sums.xy = totals[3];
  sums.yy = totals[4];
  sums.xa = totals[5];
  sums.ya = totals[6];
  sums.xb = totals[7];
  totals = sumLanes({wy, wa * radiance, wa, w, wx * residual, wy * residual, wa * residual, wr});
  sums.yb = totals[0];
  sums.aa = totals[1];
  sums.ab = totals[2];
  sums.bb = totals[3];
  sums.xr = totals[4];
  sums.yr = totals[5];
  sums.ar = totals[6];
  sums.br = totals[7];
  return true;
}

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

constexpr std::size_t kChunk = 128;  // points of one part of the work
constexpr std::size_t kChunksPerTask = 2;
constexpr float kMinDepthCurvature = 1e-10F;

/// One residual in relative coordinates: rows of the products with the 2x2 patch block.
struct ResidualTerms {
  PatchSums patch;
  ResidualGeometry geometry;
  alignas(32) float x[kRowLanes] = {};  // patch block times geometry, brightness, residual
  alignas(32) float y[kRowLanes] = {};
};

DSORB_ALWAYS_INLINE void sumRows(ResidualTerms& terms, std::size_t lanes) {
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
  const Lanes x = load(terms.x);
  const Lanes y = load(terms.y);
  const Lanes rest_x = load(terms.x + kLanes);
  const Lanes rest_y = load(terms.y + kLanes);
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
  const Lanes x = load(terms.x);
  const Lanes y = load(terms.y);
  for (std::size_t row = 0; row < kPoseRows; ++row) {
    addLanes(g.x[row] * x + g.y[row] * y, sums.rows[row]);
  }
  addLanes(residualColumn(g, terms.x, terms.y), sums.residual);
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

  void add(const PairSums& sums) {
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
  /// Rounding makes the two triangles differ; the upper one counts.
  void makeSymmetric() {
    H = Matrix8d(H.selfadjointView<Eigen::Upper>());
    camera = CameraMatrix(camera.selfadjointView<Eigen::Upper>());
  }
};

/// Adds one pair to the system of absolute states.
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
  addBoth(Matrix8d(host_H * to_target), host, target, out.H);
  out.b.segment<8>(host) += pair.to_host * blocks.b;
  out.b.segment<8>(target) += to_target * blocks.b;
  using CameraBlock = Eigen::Matrix<double, kFrameDim, kCameraDim>;
  addBoth(CameraBlock(pair.to_host * blocks.H_camera), host, 0, out.H);
  addBoth(CameraBlock(to_target * blocks.H_camera), target, 0, out.H);
  out.H.topLeftCorner<kCameraDim, kCameraDim>() += blocks.camera;
  out.b.head<kCameraDim>() += blocks.b_camera;
}

/// Asks for the part of the target's image that evaluatePatch() will read: the images of a window
/// are larger than the caches, and waiting for them takes longer than computing with them.
DSORB_ALWAYS_INLINE void prefetchPatch(const WindowPoint& point,
                                       const HostRays& rays,
                                       const PairGeometry& pair) {
  const Eigen::Vector2f ray = rays.at(point.patch.pixel);
  const WarpedPoint<float> p = warpPoint(pair.current.warp, ray.x(), ray.y(), point.inverse_depth);
  const float margin = kPatternRadius + kFarBorder;
  const TargetImage& target = pair.current;
  const bool inside = p.x > margin && p.y > margin &&
                      p.x < static_cast<float>(target.width) - margin &&
                      p.y < static_cast<float>(target.height) - margin;
  if (!inside) return;
  // The pattern, its interpolation and its gradients.
  constexpr int kSide = 2 * kPatternRadius + 3;
  constexpr int kBefore = kPatternRadius + 1;
  const float* row = target.pixels + (static_cast<std::ptrdiff_t>(p.y) - kBefore) * target.width +
                     (static_cast<std::ptrdiff_t>(p.x) - kBefore);
  for (int y = 0; y <= kSide; ++y, row += target.width) {
    __builtin_prefetch(row);
    __builtin_prefetch(row + kSide);
  }
}

/// Everything the evaluation of one chunk reads and writes.
struct ChunkContext {
  Window* window;
  const PairTable* pairs;
  const PointRef* refs;
  const LinearizeOptions* options;
  std::vector<Vector8d> frame_deviation;     // for frozen residuals
  std::vector<Vector6d> velocity_deviation;  // the same
  PairSums* sums;                            // by target
  VelocitySums* velocity_sums;               // the same; null: global shutter
  WindowEquations* out;
  std::ptrdiff_t frame_dimension;
};

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

/// Adds one residual to the row of its point. @return its share of (D, b_d)
DSORB_ALWAYS_INLINE Eigen::Vector2f couple(const ResidualTerms& terms,
                                           const PairGeometry& pair,
                                           bool velocities,
                                           float* host,
                                           float* target) {
  const PatchSums& p = terms.patch;
  const float jx = terms.geometry.depth_x;
  const float jy = terms.geometry.depth_y;
  const Lanes x = load(terms.x);
  const Lanes y = load(terms.y);
  alignas(32) float relative[kFrameDim];
  store(x * jx + y * jy, relative);
  alignas(32) float by_host[kFrameDim];
  alignas(32) float by_target[kFrameDim];
  Lanes sum = {};
  for (Index k = 0; k < kFrameDim; ++k) {
    sum += load(pair.to_host_single.col(k).data()) * relative[k];
  }
  store(sum, by_host);
  for (Index i = 0; i < kFrameDim; ++i) by_target[i] = pair.to_target_single[i] * relative[i];
  for (Index i = 0; i < kFrameDim; ++i) {
    host[i] += by_host[i];
    target[i] += by_target[i];
  }
  if (velocities) {
    for (Index i = 0; i < kPoseRows; ++i) {
      host[kFrameDim + i] += terms.geometry.host_time * by_host[i];
      target[kFrameDim + i] += terms.geometry.target_time * by_target[i];
    }
  }
  return {jx * (p.xx * jx + p.xy * jy) + jy * (p.xy * jx + p.yy * jy), jx * p.xr + jy * p.yr};
}

/// The same for the camera.
DSORB_ALWAYS_INLINE void coupleCamera(const ResidualTerms& terms, float* row) {
  for (std::size_t i = 0; i < kCameraDim; ++i) {
    row[i] += terms.x[kLaneCamera + i] * terms.geometry.depth_x +
              terms.y[kLaneCamera + i] * terms.geometry.depth_y;
  }
}

/// Relative state of a pair less its first estimate.
DSORB_ALWAYS_INLINE Vector8d relativeDeviation(const ChunkContext& context,
                                               const PairGeometry& pair,
                                               const ResidualGeometry& geometry,
                                               std::size_t host,
                                               std::size_t target) {
  Vector8d relative = pair.to_host.transpose() * context.frame_deviation[host] +
                      pair.to_target.cwiseProduct(context.frame_deviation[target]);
  if (context.velocity_sums != nullptr) {
    relative.head<6>() +=
        static_cast<double>(geometry.host_time) * pair.to_host.topLeftCorner<6, 6>().transpose() *
            context.velocity_deviation[host] +
        static_cast<double>(geometry.target_time) *
            pair.to_target.head<6>().cwiseProduct(context.velocity_deviation[target]);
  }
  return relative;
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
      const Vector8d relative =
          relativeDeviation(context, pair, terms.geometry, chunk.host, target);
      freeze(terms.patch, terms.geometry, relative, context.window->camera_state);
    }
    sumRows(terms, camera ? kRowLanes : kPoseLanes);
    accumulate(terms, camera, context.sums[target]);
    const bool velocities = context.velocity_sums != nullptr;
    if (velocities) {
      accumulateVelocities(terms.geometry, terms.x, terms.y, camera, context.velocity_sums[target]);
    }
    const auto state_of = [&](std::size_t keyframe) {
      return row + kCameraDim + context.frame_dimension * static_cast<std::ptrdiff_t>(keyframe);
    };
    const Eigen::Vector2f depth =
        couple(terms, pair, velocities, state_of(chunk.host), state_of(target));
    if (camera) coupleCamera(terms, row);
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

}  // namespace

DSORB_TARGET_CLONES bool evaluatePatch(const WindowPoint& point,
                                       const HostRays& rays,
                                       const PairGeometry& pair,
                                       PatchSums& sums) {
  return pair.current.corrected ? sumPatch<true>(point, rays, pair, sums)
                                : sumPatch<false>(point, rays, pair, sums);
}

bool evaluateGeometry(const WindowPoint& point,
                      const HostRays& rays,
                      const PairGeometry& pair,
                      EstimatedCamera camera,
                      ResidualGeometry& geometry) {
  const Eigen::Vector2f ray = rays.at(point.patch.pixel);
  const WarpedPoint<float> p = warpPoint(pair.first, ray.x(), ray.y(), point.inverse_depth);
  if (!p.front) return false;
  const PixelJacobian<float> J = pixelJacobian(pair.first, p, point.inverse_depth);
  std::copy_n(J.x, kPoseRows, geometry.x);
  std::copy_n(J.y, kPoseRows, geometry.y);
  geometry.depth_x = J.depth.x;
  geometry.depth_y = J.depth.y;
  if (pair.current.corrected) addTimes(point, pair, p, geometry);
  if (camera.intrinsics) addLens(ray, pair, p, camera.radial, geometry);
  if (camera.readout) addReadout(point, rays, pair, p, geometry);
  return true;
}

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

void NormalEquationsBuilder::stitch(const Window& window,
                                    const PairTable& pairs,
                                    WindowEquations& out) const {
  const std::size_t frames = pairs.size();
  for (std::size_t host = 0; host < frames; ++host) {
    for (std::size_t target = 0; target < frames; ++target) {
      if (host == target) continue;
      PairBlocks blocks;
      for (std::size_t c = 0; c < chunks_.size(); ++c) {
        if (chunks_[c].host == host) blocks.add(pair_sums_[c * frames + target]);
      }
      blocks.makeSymmetric();
      const PairRows rows{window.rowOf(host), window.rowOf(target)};
      addPair(blocks, pairs.at(host, target), rows, out);
      if (!window.hasVelocities()) continue;
      VelocitySums velocities{};
      for (std::size_t c = 0; c < chunks_.size(); ++c) {
        if (chunks_[c].host == host) add(velocity_sums_[c * frames + target], velocities);
      }
      addVelocities(velocities, pairs.at(host, target), rows, out);
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
  const bool rolling = window.hasVelocities();
  if (rolling) velocity_sums_.assign(chunks_.size() * pairs.size(), VelocitySums{});
  ChunkContext context{&window,
                       &pairs,
                       points.data(),
                       &options,
                       {},
                       {},
                       nullptr,
                       nullptr,
                       &out,
                       window.frameDimension()};
  for (const Keyframe& keyframe : window.keyframes) {
    context.frame_deviation.emplace_back(keyframe.state - keyframe.first);
    context.velocity_deviation.emplace_back(keyframe.velocityFrom(keyframe.first_velocity));
  }
  forEachRange(chunks_.size(), kChunksPerTask, [&](std::size_t begin, std::size_t end) {
    ChunkContext mine = context;
    for (std::size_t c = begin; c < end; ++c) {
      mine.sums = pair_sums_.data() + c * pairs.size();
      if (rolling) mine.velocity_sums = velocity_sums_.data() + c * pairs.size();
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
  stitch(window, pairs, out);
}

void evaluateFrom(std::size_t first_target,
                  Window& window,
                  const PairTable& pairs,
                  const std::vector<PointRef>& points) {
  const auto evaluate_one = [&](const PointRef& ref) {
    WindowPoint& point = window.keyframes[ref.keyframe].points[ref.point];
    for (Observation& observation : point) {
      const std::size_t target = observation.target;
      if (target < first_target || observation.state == ResidualState::kOutOfBounds) continue;
      PatchSums patch;
      const bool seen = evaluatePatch(point, pairs.rays(), pairs.at(ref.keyframe, target), patch);
      observation.trial_state = seen ? ResidualState::kIn : ResidualState::kOutOfBounds;
      if (seen) observation.trial_raw = patch.energy;
    }
  };
  forEachRange(points.size(), kChunk * kChunksPerTask, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) evaluate_one(points[i]);
  });
}

}  // namespace dsorb::window
