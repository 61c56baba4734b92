// SPDX-License-Identifier: BSD-3-Clause
#include "estimate/reprojection_kernels.h"

#include "base/target_clones.h"
#include "estimate/robust_loss.h"

#include <algorithm>
#include <cmath>

namespace dsorb {
namespace {

using Mask = MaskOf<DoubleLanes>;

// Factors of a product whose logarithm is taken: each is below 1e30, so it does not overflow.
constexpr std::size_t kErrorFactors = 8;

/// Sums of PoseSums, by lane.
struct LaneSums {
  DoubleLanes hessian[kPoseSize * (kPoseSize + 1) / 2];  // rows of the upper triangle
  DoubleLanes gradient[kPoseSize];
  DoubleLanes cost;
  DoubleLanes weighted_square;
  DoubleLanes observations;
  DoubleLanes within;
  DoubleLanes behind;
};

/// Projections of four corners with their derivatives.
struct Projection {
  DoubleLanes error_x, error_y;  // projected minus seen [px]
  PixelJacobian<DoubleLanes> J;
  Mask front;
};

DSORB_ALWAYS_INLINE Projection project(const Warp<double>& frame,
                                       const ObservationRun& run,
                                       std::size_t i) {
  const DoubleLanes rho = loadDoubles(run.inverse_depth + i);
  const WarpedPoint<DoubleLanes> point =
      warpPoint(frame, loadDoubles(run.ray_x + i), loadDoubles(run.ray_y + i), rho);
  return {point.x - loadDoubles(run.pixel_x + i),
          point.y - loadDoubles(run.pixel_y + i),
          pixelJacobian(frame, point, rho),
          point.front};
}

/// Inverse covariances of four observations, zero where there is none, later times the weight.
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
  const DoubleLanes zero = {};
  const auto one = spread<DoubleLanes>(1.0);
  const Mask known = information.xx > zero;
  const Mask used = known & at.front;
  sums.observations += used ? one : zero;
  sums.behind += known & ~at.front ? one : zero;
  information.xx = used ? information.xx : zero;
  information.xy = used ? information.xy : zero;
  information.yy = used ? information.yy : zero;
  const DoubleLanes square =
      at.error_x * (information.xx * at.error_x + 2.0 * information.xy * at.error_y) +
      information.yy * at.error_y * at.error_y;
  const Mask outside = square > one * (loss.limit * loss.limit);
  sums.within += used & ~outside ? one : zero;
  DoubleLanes weight;
  if constexpr (kLoss == RobustLoss::kHuber) {
    DoubleLanes norm = square;
    for (int k = 0; k < kDoubleLanes; ++k) norm[k] = std::sqrt(norm[k]);
    weight = huberWeights<DoubleLanes>(norm, one * loss.limit);
    sums.cost += 0.5 * weight * square * (2.0 - weight);
  } else {
    const DoubleLanes ratio = cauchyRatio(square, loss.limit);
    weight = 1.0 / ratio;
    product *= ratio;
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
                                 const PointSums<double>& depths,
                                 LaneSums& sums) {
  const PixelJacobian<DoubleLanes>& J = at.J;
  DoubleLanes coupling[kPoseSize];
  const DoubleLanes error_x = information.xx * at.error_x + information.xy * at.error_y;
  const DoubleLanes error_y = information.xy * at.error_x + information.yy * at.error_y;
  // J.x[1] and J.y[0] are zero, and not touched.
  int entry = 0;
#pragma GCC unroll 6
  for (int r = 0; r < kPoseSize; ++r) {
    DoubleLanes x;  // derivatives by this unknown, times the information
    DoubleLanes y;
    DoubleLanes gradient;
    if (r == 0) {
      x = information.xx * J.x[r];
      y = information.xy * J.x[r];
      gradient = J.x[r] * error_x;
    } else if (r == 1) {
      x = information.xy * J.y[r];
      y = information.yy * J.y[r];
      gradient = J.y[r] * error_y;
    } else {
      x = information.xx * J.x[r] + information.xy * J.y[r];
      y = information.xy * J.x[r] + information.yy * J.y[r];
      gradient = J.x[r] * error_x + J.y[r] * error_y;
    }
    sums.gradient[r] += gradient;
#pragma GCC unroll 6
    for (int c = r; c < kPoseSize; ++c) {
      if (c == 0) {
        sums.hessian[entry++] += x * J.x[c];
      } else if (c == 1) {
        sums.hessian[entry++] += y * J.y[c];
      } else {
        sums.hessian[entry++] += x * J.x[c] + y * J.y[c];
      }
    }
    if constexpr (kDepths) coupling[r] = x * J.depth.x + y * J.depth.y;
  }
  if constexpr (kDepths) {
    storeTransposed(coupling, depths.coupling + i * depths.stride, depths.stride);
    const DoubleLanes x = information.xx * J.depth.x + information.xy * J.depth.y;
    const DoubleLanes y = information.xy * J.depth.x + information.yy * J.depth.y;
    double* const hessian = depths.hessian + i;
    double* const gradient = depths.gradient + i;
    store(loadDoubles(hessian) + x * J.depth.x + y * J.depth.y, hessian);
    store(loadDoubles(gradient) + J.depth.x * error_x + J.depth.y * error_y, gradient);
  }
}

template <RobustLoss kLoss, bool kDepths>
DSORB_ALWAYS_INLINE void linearizeAs(const Warp<double>& frame,
                                     const ObservationRun& run,
                                     const LossSetting& loss,
                                     const PointSums<double>& depths,
                                     LaneSums& result) {
  LaneSums sums = {};  // a local one stays in registers
  const double half_square = 0.5 * loss.limit * loss.limit;
  for (std::size_t begin = 0; begin < run.count; begin += kErrorFactors * kDoubleLanes) {
    const std::size_t end = std::min(run.count, begin + kErrorFactors * kDoubleLanes);
    auto product = spread<DoubleLanes>(1.0);
    for (std::size_t i = begin; i < end; i += kDoubleLanes) {
      const Projection at = project(frame, run, i);
      Information information{loadDoubles(run.information_xx + i),
                              loadDoubles(run.information_xy + i),
                              loadDoubles(run.information_yy + i)};
      weigh<kLoss>(loss, at, information, product, sums);
      addSums<kDepths>(at, information, i, depths, sums);
    }
    if constexpr (kLoss == RobustLoss::kCauchy) {
      for (int k = 0; k < kDoubleLanes; ++k) sums.cost[k] += half_square * std::log(product[k]);
    }
  }
  result = sums;
}

DSORB_TARGET_CLONES void linearizeInLanes(const Warp<double>& frame,
                                          const ObservationRun& run,
                                          const LossSetting& loss,
                                          const PointSums<double>& depths,
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

PoseSums& PoseSums::operator+=(const PoseSums& other) {
  hessian += other.hessian;
  gradient += other.gradient;
  cost += other.cost;
  weighted_square += other.weighted_square;
  observations += other.observations;
  within += other.within;
  behind += other.behind;
  return *this;
}

void linearizeObservations(const Warp<double>& frame,
                           const ObservationRun& run,
                           const LossSetting& loss,
                           const PointSums<double>& depths,
                           PoseSums& sums) {
  LaneSums lanes = {};
  linearizeInLanes(frame, run, loss, depths, lanes);
  const DoubleLanes* entry = lanes.hessian;
  for (int r = 0; r < kPoseSize; ++r) {
    for (int c = r; c < kPoseSize; ++c) sums.hessian(r, c) += sumLanes(*entry++);
    sums.gradient[r] += sumLanes(lanes.gradient[r]);
  }
  sums.hessian.triangularView<Eigen::StrictlyLower>() = sums.hessian.transpose();
  sums.cost += sumLanes(lanes.cost);
  sums.weighted_square += sumLanes(lanes.weighted_square);
  sums.observations += sumLanes(lanes.observations);
  sums.within += sumLanes(lanes.within);
  sums.behind += sumLanes(lanes.behind);
}

}  // namespace dsorb
