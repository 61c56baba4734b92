// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/bundle/reprojection_kernels.h"

#include "base/lanes.h"
#include "base/target_clones.h"

#include <algorithm>
#include <cmath>

namespace dsorb::init_orb {
namespace {

using Mask = long long __attribute__((vector_size(32)));

constexpr double kMinZ = 1e-6;  // of a point over its depth in the reference; as projectHosted()
// Factors of a product whose logarithm is taken: each is below 1e30, so it does not overflow.
constexpr std::size_t kFactors = 8;

/// Sums of PoseSums, by lane.
struct LaneSums {
  DoubleLanes hessian[kPoseTriangle];
  DoubleLanes gradient[kPoseSize];
  DoubleLanes cost;
  DoubleLanes weighted_square;
  DoubleLanes sightings;
  DoubleLanes within;
  DoubleLanes behind;
};

/// Projections of four corners with their derivatives.
struct Projection {
  DoubleLanes error_x, error_y;                      // projected minus seen [px]
  DoubleLanes pose_x[kPoseSize], pose_y[kPoseSize];  // derivatives by the pose
  DoubleLanes depth_x, depth_y;                      // by the inverse depth
  Mask front;
};

DSORB_ALWAYS_INLINE void project(const SightingFrame& f,
                                 const SightingRun& run,
                                 std::size_t i,
                                 Projection& out) {
  DoubleLanes rx;
  DoubleLanes ry;
  DoubleLanes rho;
  DoubleLanes seen_x;
  DoubleLanes seen_y;
  load(run.ray_x + i, rx);
  load(run.ray_y + i, ry);
  load(run.inverse_depth + i, rho);
  load(run.pixel_x + i, seen_x);
  load(run.pixel_y + i, seen_y);
  const DoubleLanes px = f.R[0] * rx + f.R[1] * ry + (f.R[2] + rho * f.t[0]);
  const DoubleLanes py = f.R[3] * rx + f.R[4] * ry + (f.R[5] + rho * f.t[1]);
  const DoubleLanes pz = f.R[6] * rx + f.R[7] * ry + (f.R[8] + rho * f.t[2]);
  DoubleLanes min_z;
  fill(kMinZ, min_z);
  out.front = pz > min_z;
  const DoubleLanes inverse_z = 1.0 / (out.front ? pz : min_z);
  const DoubleLanes u = px * inverse_z;
  const DoubleLanes v = py * inverse_z;
  const DoubleLanes fx_rho = f.fx * rho * inverse_z;
  const DoubleLanes fy_rho = f.fy * rho * inverse_z;
  const DoubleLanes uv = u * v;
  out.error_x = f.fx * u + (f.cx - seen_x);
  out.error_y = f.fy * v + (f.cy - seen_y);
  out.pose_x[0] = fx_rho;
  out.pose_x[2] = -fx_rho * u;
  out.pose_x[3] = -f.fx * uv;
  out.pose_x[4] = f.fx + f.fx * u * u;
  out.pose_x[5] = -f.fx * v;
  out.pose_y[1] = fy_rho;
  out.pose_y[2] = -fy_rho * v;
  out.pose_y[3] = -f.fy - f.fy * v * v;
  out.pose_y[4] = f.fy * uv;
  out.pose_y[5] = f.fy * u;
  out.depth_x = f.fx * inverse_z * (f.t[0] - u * f.t[2]);
  out.depth_y = f.fy * inverse_z * (f.t[1] - v * f.t[2]);
}

/// Inverse covariances of four sightings, zero where there is none, later times the weight.
struct Information {
  DoubleLanes xx, xy, yy;
};

/// Square of the whitened error, and what the loss makes of it.
template <RobustLoss kLoss>
DSORB_ALWAYS_INLINE void weigh(const LossSetting& loss,
                               const Projection& at,
                               Information& information,
                               DoubleLanes& product,
                               LaneSums& sums) {
  DoubleLanes zero;
  DoubleLanes one;
  fill(0, zero);
  fill(1, one);
  const Mask known = information.xx > zero;
  const Mask used = known & at.front;
  sums.sightings += used ? one : zero;
  sums.behind += known & ~at.front ? one : zero;
  information.xx = used ? information.xx : zero;
  information.xy = used ? information.xy : zero;
  information.yy = used ? information.yy : zero;
  const DoubleLanes square =
      at.error_x * (information.xx * at.error_x + 2.0 * information.xy * at.error_y) +
      information.yy * at.error_y * at.error_y;
  const double limit_square = loss.limit * loss.limit;
  const Mask outside = square > (one * limit_square);
  sums.within += used & ~outside ? one : zero;
  DoubleLanes weight;
  if constexpr (kLoss == RobustLoss::kHuber) {
    DoubleLanes norm = square;
    for (int k = 0; k < kDoubleLanes; ++k) norm[k] = std::sqrt(norm[k]);
    weight = outside ? loss.limit / norm : one;
    sums.cost += outside ? loss.limit * norm - 0.5 * limit_square : 0.5 * square;
  } else {
    const DoubleLanes factor = 1.0 + square * (1 / limit_square);
    weight = 1.0 / factor;
    product *= factor;
  }
  sums.weighted_square += weight * square;
  information.xx *= weight;
  information.xy *= weight;
  information.yy *= weight;
}

template <bool kDepths>
DSORB_ALWAYS_INLINE void addSums(const Projection& at,
                                 const Information& information,
                                 std::size_t i,
                                 const DepthSums& depths,
                                 LaneSums& sums) {
  const DoubleLanes error_x = information.xx * at.error_x + information.xy * at.error_y;
  const DoubleLanes error_y = information.xy * at.error_x + information.yy * at.error_y;
  // pose_x[1] and pose_y[0] are zero, and not touched.
  int entry = 0;
#pragma GCC unroll 6
  for (int r = 0; r < kPoseSize; ++r) {
    DoubleLanes x;  // derivatives by this unknown, times the information
    DoubleLanes y;
    DoubleLanes gradient;
    if (r == 0) {
      x = information.xx * at.pose_x[r];
      y = information.xy * at.pose_x[r];
      gradient = at.pose_x[r] * error_x;
    } else if (r == 1) {
      x = information.xy * at.pose_y[r];
      y = information.yy * at.pose_y[r];
      gradient = at.pose_y[r] * error_y;
    } else {
      x = information.xx * at.pose_x[r] + information.xy * at.pose_y[r];
      y = information.xy * at.pose_x[r] + information.yy * at.pose_y[r];
      gradient = at.pose_x[r] * error_x + at.pose_y[r] * error_y;
    }
    sums.gradient[r] += gradient;
#pragma GCC unroll 6
    for (int c = r; c < kPoseSize; ++c) {
      if (c == 0) {
        sums.hessian[entry++] += x * at.pose_x[c];
      } else if (c == 1) {
        sums.hessian[entry++] += y * at.pose_y[c];
      } else {
        sums.hessian[entry++] += x * at.pose_x[c] + y * at.pose_y[c];
      }
    }
    if constexpr (kDepths) {
      store(x * at.depth_x + y * at.depth_y,
            depths.coupling + static_cast<std::size_t>(r) * depths.stride + i);
    }
  }
  if constexpr (kDepths) {
    const DoubleLanes x = information.xx * at.depth_x + information.xy * at.depth_y;
    const DoubleLanes y = information.xy * at.depth_x + information.yy * at.depth_y;
    DoubleLanes hessian;
    DoubleLanes gradient;
    load(depths.hessian + i, hessian);
    load(depths.gradient + i, gradient);
    store(hessian + x * at.depth_x + y * at.depth_y, depths.hessian + i);
    store(gradient + at.depth_x * error_x + at.depth_y * error_y, depths.gradient + i);
  }
}

template <RobustLoss kLoss, bool kDepths>
DSORB_ALWAYS_INLINE void linearizeAs(const SightingFrame& frame,
                                     const SightingRun& run,
                                     const LossSetting& loss,
                                     const DepthSums& depths,
                                     LaneSums& result) {
  LaneSums sums = {};  // a local one stays in registers
  const double half_square = 0.5 * loss.limit * loss.limit;
  for (std::size_t begin = 0; begin < run.count; begin += kFactors * kDoubleLanes) {
    const std::size_t end = std::min(run.count, begin + kFactors * kDoubleLanes);
    DoubleLanes product;
    fill(1, product);
    for (std::size_t i = begin; i < end; i += kDoubleLanes) {
      Projection at;
      project(frame, run, i, at);
      Information information;
      load(run.information_xx + i, information.xx);
      load(run.information_xy + i, information.xy);
      load(run.information_yy + i, information.yy);
      weigh<kLoss>(loss, at, information, product, sums);
      addSums<kDepths>(at, information, i, depths, sums);
    }
    if constexpr (kLoss == RobustLoss::kCauchy) {
      for (int k = 0; k < kDoubleLanes; ++k) sums.cost[k] += half_square * std::log(product[k]);
    }
  }
  result = sums;
}

DSORB_TARGET_CLONES void linearizeInLanes(const SightingFrame& frame,
                                          const SightingRun& run,
                                          const LossSetting& loss,
                                          const DepthSums& depths,
                                          LaneSums& sums) {
  const bool free = depths.coupling != nullptr;
  if (loss.loss == RobustLoss::kHuber) {
    free ? linearizeAs<RobustLoss::kHuber, true>(frame, run, loss, depths, sums)
         : linearizeAs<RobustLoss::kHuber, false>(frame, run, loss, depths, sums);
  } else {
    free ? linearizeAs<RobustLoss::kCauchy, true>(frame, run, loss, depths, sums)
         : linearizeAs<RobustLoss::kCauchy, false>(frame, run, loss, depths, sums);
  }
}

}  // namespace

SightingFrame sightingFrame(const PinholeCamera& camera, const SE3& T_cam_ref) {
  SightingFrame frame{};
  const Eigen::Matrix3d R = T_cam_ref.rotationMatrix();
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      const int entry = 3 * row + column;
      frame.R[static_cast<std::size_t>(entry)] = R(row, column);
    }
    frame.t[static_cast<std::size_t>(row)] = T_cam_ref.translation()[row];
  }
  frame.fx = camera.fx;
  frame.fy = camera.fy;
  frame.cx = camera.cx;
  frame.cy = camera.cy;
  return frame;
}

PoseSums& PoseSums::operator+=(const PoseSums& other) {
  for (std::size_t i = 0; i < hessian.size(); ++i) hessian[i] += other.hessian[i];
  for (std::size_t i = 0; i < gradient.size(); ++i) gradient[i] += other.gradient[i];
  cost += other.cost;
  weighted_square += other.weighted_square;
  sightings += other.sightings;
  within += other.within;
  behind += other.behind;
  return *this;
}

Matrix6d hessianOf(const PoseSums& sums) {
  Matrix6d hessian;
  const double* entry = sums.hessian.data();
  for (int r = 0; r < kPoseSize; ++r) {
    for (int c = r; c < kPoseSize; ++c) hessian(c, r) = hessian(r, c) = *entry++;
  }
  return hessian;
}

void linearizeSightings(const SightingFrame& frame,
                        const SightingRun& run,
                        const LossSetting& loss,
                        const DepthSums& depths,
                        PoseSums& sums) {
  LaneSums lanes = {};
  linearizeInLanes(frame, run, loss, depths, lanes);
  for (std::size_t i = 0; i < kPoseTriangle; ++i) sums.hessian[i] += sumLanes(lanes.hessian[i]);
  for (std::size_t i = 0; i < kPoseSize; ++i) sums.gradient[i] += sumLanes(lanes.gradient[i]);
  sums.cost += sumLanes(lanes.cost);
  sums.weighted_square += sumLanes(lanes.weighted_square);
  sums.sightings += sumLanes(lanes.sightings);
  sums.within += sumLanes(lanes.within);
  sums.behind += sumLanes(lanes.behind);
}

DSORB_TARGET_CLONES void eliminateCorners(const CouplingRun& run, double* matrix, double* vector) {
  for (std::size_t r = 0; r < run.rows; ++r) {
    const double* row = run.coupling + r * run.stride;
    for (std::size_t first = 0; first <= r; first += kPoseSize) {
      DoubleLanes sums[kPoseSize] = {};
      for (std::size_t i = 0; i < run.count; i += kDoubleLanes) {
        DoubleLanes scaled;
        DoubleLanes inverse;
        load(row + i, scaled);
        load(run.inverse + i, inverse);
        scaled *= inverse;
        for (std::size_t c = 0; c < kPoseSize; ++c) {
          DoubleLanes other;
          load(run.coupling + (first + c) * run.stride + i, other);
          sums[c] += scaled * other;
        }
      }
      for (std::size_t c = 0; c < kPoseSize && first + c <= r; ++c) {
        matrix[r * run.rows + first + c] += sumLanes(sums[c]);
      }
    }
    DoubleLanes sum = {};
    for (std::size_t i = 0; i < run.count; i += kDoubleLanes) {
      DoubleLanes coupling;
      DoubleLanes inverse;
      DoubleLanes gradient;
      load(row + i, coupling);
      load(run.inverse + i, inverse);
      load(run.gradient + i, gradient);
      sum += coupling * inverse * gradient;
    }
    vector[r] += sumLanes(sum);
  }
}

DSORB_TARGET_CLONES void substituteBack(const CouplingRun& run,
                                        const double* step,
                                        double* depths) {
  for (std::size_t i = 0; i < run.count; i += kDoubleLanes) {
    DoubleLanes sum;
    load(run.gradient + i, sum);
    for (std::size_t r = 0; r < run.rows; ++r) {
      DoubleLanes coupling;
      load(run.coupling + r * run.stride + i, coupling);
      sum += step[r] * coupling;
    }
    DoubleLanes inverse;
    load(run.inverse + i, inverse);
    store(-inverse * sum, depths + i);
  }
}

}  // namespace dsorb::init_orb
