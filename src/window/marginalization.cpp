// SPDX-License-Identifier: BSD-3-Clause
#include "window/marginalization.h"

#include "geometry/symmetric_eigen.h"
#include "window/normal_equations.h"
#include "window/window_step.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>

namespace dsorb::window {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

// @source DSO as published, all six
constexpr int kMinResiduals = 3;         // of a point worth keeping
constexpr int kMinGoodObservations = 4;  // of a point worth marginalising
constexpr double kMinInformation = 50;   // of a depth worth marginalising [grey^2 unit^2]
constexpr int kOldObservations = 14;     // more: the point leaves before it has too few residuals
// Relative: pixels at the edge move by a few, farther than a gradient holds.
constexpr double kMaxFocalChange = 0.01;
constexpr double kMaxRadialChange = 0.01;
constexpr double kScaleOffset = 10;          // on diagonals before scaling
constexpr double kEigenvalueCutOff = 1e-12;  // relative; weaker directions carry no information

int residualsToLeaving(const WindowPoint& point, const Window& window) {
  return static_cast<int>(std::count_if(point.begin(), point.end(), [&](const Observation& o) {
    return o.state == ResidualState::kIn && window.keyframes[o.target].leaves;
  }));
}

/// Whether the residual to one of the two newest keyframes had this state when last looked at.
bool wasSeen(const WindowPoint& point, std::size_t age, ResidualState state, const Window& window) {
  const RecentState& recent = point.recent[age];
  return window.keyframes.size() > age &&
         recent.keyframe == window.keyframes[window.keyframes.size() - 1 - age].id &&
         recent.state == state;
}

bool pointLeaves(const WindowPoint& point, const Window& window) {
  const int residuals = point.num_observations;
  const bool too_few_remain = residuals >= kMinResiduals &&
                              point.good_observations > kOldObservations &&
                              residuals - residualsToLeaving(point, window) < kMinResiduals;
  const bool out_of_sight = wasSeen(point, 0, ResidualState::kOutOfBounds, window);
  const bool twice_outlier = residuals >= 2 && wasSeen(point, 0, ResidualState::kOutlier, window) &&
                             wasSeen(point, 1, ResidualState::kOutlier, window);
  return too_few_remain || out_of_sight || twice_outlier;
}

/// Adds the points to the prior: residuals linearised at the first estimates, depths eliminated.
void absorb(Window& window, const std::vector<PointRef>& points, const WindowOptions& options) {
  if (points.empty()) return;
  for (const PointRef& ref : points) {
    for (Observation& o : window.keyframes[ref.keyframe].points[ref.point]) {
      o.state = ResidualState::kIn;
    }
  }
  LinearizeOptions linearize;
  linearize.frozen = true;
  linearize.camera = estimatedCamera(window, options);
  linearize.depth_prior_factor = options.prior.depth_at_marginalization;
  linearize.depth_prior_pulls = !options.published && options.prior.depth_at_marginalization == 1;
  NormalEquationsBuilder builder;
  WindowEquations equations;
  builder.build(window, PairTable(window), points, linearize, equations);
  WindowElimination elimination;
  elimination.damp(equations, 0);
  elimination.eliminate(equations, equations.H, equations.b);
  window.prior.H += kMarginalizationWeight * MatrixXd(equations.H.selfadjointView<Eigen::Lower>());
  window.prior.b += kMarginalizationWeight * equations.b;
}

/// The prior with the rows and columns of a keyframe behind all others.
MarginalPrior keyframeLast(const Window& window, std::size_t position) {
  const MarginalPrior& prior = window.prior;
  const Index n = prior.b.size();
  const Index at = window.rowOf(position);
  const Index size = window.frameDimension();
  Eigen::VectorXi order(n);
  Index next = 0;
  for (Index i = 0; i < n; ++i) {
    if (i < at || i >= at + size) order[next++] = static_cast<int>(i);
  }
  for (Index i = 0; i < size; ++i) order[next++] = static_cast<int>(at + i);
  return {prior.H(order, order), prior.b(order)};
}

}  // namespace

PointVerdict judgePoint(const WindowPoint& point, bool host_leaves, const Window& window) {
  if (!(point.inverse_depth >= 0) || point.num_observations == 0) return PointVerdict::kDiscard;
  if (!host_leaves && !pointLeaves(point, window)) return PointVerdict::kStay;
  const bool good = point.num_observations >= kMinResiduals &&
                    point.good_observations >= kMinGoodObservations &&
                    static_cast<double>(point.information) > kMinInformation;
  return good ? PointVerdict::kMarginalize : PointVerdict::kDiscard;
}

void retirePoints(Window& window, const WindowOptions& options) {
  std::vector<PointRef> to_absorb;
  std::vector<std::vector<PointVerdict>> verdicts(window.keyframes.size());
  for (std::size_t k = 0; k < window.keyframes.size(); ++k) {
    const Keyframe& keyframe = window.keyframes[k];
    for (std::size_t p = 0; p < keyframe.points.size(); ++p) {
      verdicts[k].push_back(judgePoint(keyframe.points[p], keyframe.leaves, window));
      if (verdicts[k].back() != PointVerdict::kMarginalize) continue;
      to_absorb.push_back({static_cast<std::uint32_t>(k), static_cast<std::uint32_t>(p)});
    }
  }
  absorb(window, to_absorb, options);
  for (std::size_t k = 0; k < window.keyframes.size(); ++k) {
    Keyframe& keyframe = window.keyframes[k];
    std::size_t kept = 0;
    for (std::size_t p = 0; p < keyframe.points.size(); ++p) {
      if (verdicts[k][p] == PointVerdict::kStay) {
        if (kept != p) keyframe.points[kept] = keyframe.points[p];
        ++kept;
      } else if (verdicts[k][p] == PointVerdict::kMarginalize) {
        keyframe.marginalized.push_back(keyframe.points[p]);
      } else {
        ++keyframe.discarded;
      }
    }
    keyframe.points.resize(kept);
  }
}

MarginalPrior eliminateLast(const MarginalPrior& prior, int count) {
  const Index rest = prior.b.size() - count;
  const VectorXd scale = (prior.H.diagonal().array().abs() + kScaleOffset).sqrt();
  const VectorXd inverse_scale = scale.cwiseInverse();
  const MatrixXd H = inverse_scale.asDiagonal() * prior.H * inverse_scale.asDiagonal();
  const VectorXd b = inverse_scale.cwiseProduct(prior.b);
  const MatrixXd block = H.bottomRightCorner(count, count);
  const SymmetricEigen eigen = symmetricEigen(0.5 * (block + block.transpose()));
  const double cut_off = kEigenvalueCutOff * std::max(eigen.values.maxCoeff(), 0.0);
  const VectorXd inverse =
      (eigen.values.array() > cut_off).select(eigen.values.cwiseInverse(), 0.0);
  const MatrixXd half = inverse.cwiseSqrt().asDiagonal() * eigen.vectors.transpose();
  const MatrixXd coupling = half * H.bottomLeftCorner(count, rest);
  const MatrixXd H_rest = H.topLeftCorner(rest, rest) - coupling.transpose() * coupling;
  const VectorXd b_rest = b.head(rest) - coupling.transpose() * (half * b.tail(count));
  const auto undo = scale.head(rest).asDiagonal();
  const MatrixXd unscaled = undo * H_rest * undo;
  return {0.5 * (unscaled + unscaled.transpose()), undo * b_rest};
}

Keyframe marginalizeKeyframe(Window& window, std::size_t position, const WindowOptions& options) {
  const Keyframe& keyframe = window.keyframes[position];
  if (!keyframe.points.empty()) {
    throw std::logic_error("keyframe " + std::to_string(keyframe.id.value) + " still has " +
                           std::to_string(keyframe.points.size()) + " points");
  }
  MarginalPrior prior = keyframeLast(window, position);
  // The keyframe's own prior pulls its state to zero; the energy is expanded at the first estimate.
  const Vector8d& expansion = options.published ? keyframe.state : keyframe.first;
  const int size = window.frameDimension();
  prior.H.diagonal().tail(size).head<kFrameDim>() += keyframe.prior;
  prior.b.tail(size).head<kFrameDim>() += keyframe.prior.cwiseProduct(expansion);
  if (window.hasVelocities()) {
    const Vector6d information = velocityInformation(window, keyframe);
    const Vector6d first =
        (keyframe.first_velocity - keyframe.rows.mean.velocity).cwiseQuotient(velocityScale());
    prior.H.diagonal().tail<kVelocityDim>() += information;
    prior.b.tail<kVelocityDim>() += information.cwiseProduct(first);
  }
  window.prior = eliminateLast(prior, size);
  return removeKeyframe(window, position);
}

void forgetGuess(Window& window, const WindowOptions& options) {
  if (!estimatedCamera(window, options).radial) return;
  const PinholeCamera camera = window.camera();
  const double focal = 0.5 * (camera.fx + camera.fy);
  const double radial = window.change().radial;
  const bool same = std::abs(focal / window.prior_focal - 1) < kMaxFocalChange &&
                    std::abs(radial - window.prior_radial) < kMaxRadialChange;
  if (same) return;
  window.prior_focal = focal;
  window.prior_radial = radial;
  window.forgotten = window.keyframes.back().id.value;
  window.prior.H.setZero();
  window.prior.b.setZero();
  for (Keyframe& keyframe : window.keyframes) {
    for (WindowPoint& point : keyframe.points) point.prior_information = 0;
  }
}

std::vector<Keyframe> marginalizeFlagged(Window& window, const WindowOptions& options) {
  std::vector<Keyframe> gone;
  for (std::size_t i = 0; i < window.keyframes.size();) {
    if (window.keyframes[i].leaves) {
      gone.push_back(marginalizeKeyframe(window, i, options));
    } else {
      ++i;
    }
  }
  return gone;
}

}  // namespace dsorb::window
