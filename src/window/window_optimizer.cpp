// SPDX-License-Identifier: BSD-3-Clause
#include "window/window_optimizer.h"

#include "geometry/symmetric_eigen.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

namespace dsorb::window {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr std::size_t kSmallWindow = 4;   // fewer keyframes get more iterations
constexpr int kMaxIterationsSmall = 15;   // while the window is small. @source DSO as published
constexpr double kInitialDamping = 1e-5;  // of the diagonal. @source DSO as published
constexpr int kNullSpaceFrom =
    2;  // first iteration whose step has gauge motion removed; as published
constexpr double kDampingOnSuccess = 0.25;  // @source DSO as published
constexpr double kDampingOnFailure = 100;   // @source DSO as published
constexpr double kMinDampingOnFailure = 1e-2;
constexpr double kSingularCutOff = 1e-5;  // relative, of gauge directions
constexpr int kMaxUndone = 3;             // steps undone in one adjustment; then the iteration ends

// Limits of a step that ends the iteration, scaled units: a, b, rotation, translation times mean
// inverse depth. @source DSO as published
constexpr double kSmallA = 5e-4;
constexpr double kSmallB = 5e-5;
constexpr double kSmallRotation = 5e-5;
constexpr double kSmallTranslation = 5e-5;
constexpr double kSlack = 1.2;  // factor on all four

// Outlier threshold (13 + 0.75 sqrt(E))^2 with E the 70 % quantile. @source DSO as published
constexpr double kThresholdQuantile = 0.7;
constexpr float kThresholdConstant = 0.5F * 26.0F;  // root of a patch energy [grey levels]
constexpr float kThresholdFactor = 0.5F * 1.5F;
constexpr float kBaselineUnit = 0.01F;  // relative baseline per pixel of parallax

double marginalEnergy(const Window& window) {
  const VectorXd d = window.deviation();
  return d.dot(window.prior.H * d) + 2 * window.prior.b.dot(d);
}

void commit(Window& window) {
  for (Keyframe& keyframe : window.keyframes) {
    for (WindowPoint& point : keyframe.points) {
      for (Observation& observation : point) {
        observation.state = observation.trial_state;
        observation.energy = observation.trial_energy;
      }
    }
  }
}

void resetResiduals(Window& window) {
  for (Keyframe& keyframe : window.keyframes) {
    for (WindowPoint& point : keyframe.points) {
      for (Observation& observation : point) {
        observation.state = ResidualState::kIn;
        observation.energy = 0;
      }
    }
  }
}

/// Parallax of a point in a target: distance between its projections at its depth and at infinity.
float parallax(const WindowPoint& point, const PairGeometry& pair) {
  const Eigen::Vector3f infinity = pair.KRKi * point.pixel.homogeneous();
  const Eigen::Vector3f at_depth = infinity + pair.Kt * point.inverse_depth;
  return (infinity.hnormalized() - at_depth.hnormalized()).norm();
}

/// Notes the final evaluation in one point and removes unused residuals.
void closePoint(WindowPoint& point,
                const Window& window,
                const PairTable& pairs,
                std::size_t host) {
  for (const Observation& observation : point) {
    const KeyframeId target = window.keyframes[observation.target].id;
    for (RecentState& recent : point.recent) {
      if (recent.keyframe == target) recent.state = observation.state;
    }
    if (observation.state != ResidualState::kIn) continue;
    ++point.good_observations;
    const float seen = kBaselineUnit * parallax(point, pairs.at(host, observation.target));
    point.relative_baseline = std::max(point.relative_baseline, seen);
  }
  point.removeObservations([](const Observation& o) { return o.state != ResidualState::kIn; });
}

}  // namespace

StatePrior statePrior(const Window& window, const WindowOptions& options) {
  StatePrior prior{VectorXd::Zero(window.dimension()), VectorXd::Zero(window.dimension()), 0};
  VectorXd value(window.dimension());
  value.head<kCameraDim>() = window.camera_state;
  if (options.optimizer.optimize_intrinsics) {
    prior.information.head<kCameraDim>().setConstant(options.prior.intrinsics);
  }
  Index at = kCameraDim;
  for (const Keyframe& keyframe : window.keyframes) {
    prior.information.segment<kFrameDim>(at) = keyframe.prior;
    value.segment<kFrameDim>(at) = keyframe.state;
    at += kFrameDim;
  }
  prior.gradient = prior.information.cwiseProduct(value);
  prior.energy = prior.gradient.dot(value);
  return prior;
}

MatrixXd gaugeDirections(const Window& window) {
  MatrixXd directions = MatrixXd::Zero(window.dimension(), 7);
  const Eigen::Matrix<double, 6, 1> to_scaled = frameScale().head<6>().cwiseInverse();
  Index at = kCameraDim;
  for (const Keyframe& keyframe : window.keyframes) {
    const SE3& T = keyframe.T_cam_world_first;
    directions.block<6, 6>(at, 0) = to_scaled.asDiagonal() * T.adjoint();
    directions.block<3, 1>(at, 6) = to_scaled.head<3>().cwiseProduct(T.translation());
    at += kFrameDim;
  }
  for (Index i = 0; i < directions.cols(); ++i) {
    const double norm = directions.col(i).norm();
    if (norm > 0) directions.col(i) /= norm;
  }
  return directions;
}

VectorXd withoutGauge(const VectorXd& step, const MatrixXd& directions) {
  const Eigen::Matrix<double, 7, 7> gram = directions.transpose() * directions;
  const SymmetricEigen eigen = symmetricEigen(gram);
  const double cut_off = kSingularCutOff * kSingularCutOff * eigen.values[6];
  VectorXd result = step;
  for (Index i = 0; i < 7; ++i) {
    const double eigenvalue = eigen.values[i];
    if (!(eigenvalue > cut_off)) continue;
    const VectorXd direction = directions * eigen.vectors.col(i) / std::sqrt(eigenvalue);
    result -= direction * direction.dot(step);
  }
  return result;
}

VectorXd solveStep(const Window& window,
                   const NormalEquations& equations,
                   const WindowOptions& options,
                   double damping) {
  const StatePrior prior = statePrior(window, options);
  MatrixXd H = equations.H + window.prior.H;
  H.diagonal() += prior.information;
  H.diagonal() *= 1 + damping;
  H -= equations.H_schur / (1 + damping);
  VectorXd b = equations.b + prior.gradient + window.prior.b + window.prior.H * window.deviation() -
               equations.b_schur / (1 + damping);
  if (!options.optimizer.optimize_intrinsics) {
    H.topRows<kCameraDim>().setZero();
    H.leftCols<kCameraDim>().setZero();
    H.topLeftCorner<kCameraDim, kCameraDim>().setIdentity();
    b.head<kCameraDim>().setZero();
  }
  return -solvePreconditioned(H, b);
}

void adaptNewestThreshold(Window& window) {
  const std::size_t newest = window.keyframes.size() - 1;
  std::vector<float> energies;
  for (const Keyframe& keyframe : window.keyframes) {
    for (const WindowPoint& point : keyframe.points) {
      for (const Observation& observation : point) {
        const bool counts =
            observation.target == newest && observation.trial_state != ResidualState::kOutOfBounds;
        if (counts) energies.push_back(observation.trial_raw);
      }
    }
  }
  float& threshold = window.keyframes.back().energy_threshold;
  if (energies.empty()) {
    threshold = kPatternOutlierEnergy;
    return;
  }
  const auto rank =
      static_cast<std::ptrdiff_t>(kThresholdQuantile * static_cast<double>(energies.size()));
  std::nth_element(energies.begin(), energies.begin() + rank, energies.end());
  const float root =
      kThresholdConstant + kThresholdFactor * std::sqrt(energies[static_cast<std::size_t>(rank)]);
  threshold = root * root;
}

WindowOptimizer::WindowOptimizer(const WindowOptions& options, std::size_t chunks_per_task)
    : options_(options) {
  linearize_.intrinsics = options.optimizer.optimize_intrinsics;
  linearize_.depth_prior_pulls = options.prior.depth_pulls_to_value;
  linearize_.chunks_per_task = chunks_per_task;
}

double WindowOptimizer::evaluate(Window& window, PairTable& pairs, NormalEquations& equations) {
  pairs.refreshCurrent(window);
  builder_.build(window, pairs, points_, linearize_, equations);
  return equations.energy + equations.depth_prior_energy + marginalEnergy(window) +
         statePrior(window, options_).energy;
}

void WindowOptimizer::start(Window& window, PairTable& pairs) {
  points_ = allPoints(window);
  damping_ = kInitialDamping;
  gauge_ = gaugeDirections(window);
  resetResiduals(window);
  energy_ = evaluate(window, pairs, current_);
  adaptNewestThreshold(window);
  if (options_.optimizer.fixed_thresholds) energy_ = evaluate(window, pairs, current_);
  commit(window);
}

void WindowOptimizer::save(const Window& window) {
  backup_.camera_state = window.camera_state;
  backup_.states.clear();
  backup_.inverse_depths.clear();
  for (const Keyframe& keyframe : window.keyframes) {
    backup_.states.push_back(keyframe.state);
    for (const WindowPoint& point : keyframe.points) {
      backup_.inverse_depths.push_back(point.inverse_depth);
    }
  }
}

void WindowOptimizer::restore(Window& window) const {
  window.camera_state = backup_.camera_state;
  std::size_t next = 0;
  for (std::size_t k = 0; k < window.keyframes.size(); ++k) {
    window.keyframes[k].state = backup_.states[k];
    for (WindowPoint& point : window.keyframes[k].points) {
      point.inverse_depth = backup_.inverse_depths[next++];
    }
  }
}

bool WindowOptimizer::applyStep(Window& window, const VectorXd& step, double damping) {
  const VectorXd depth_step = backSubstitute(current_, step, damping);
  if (!step.allFinite() || !depth_step.allFinite()) return false;
  if (options_.optimizer.optimize_intrinsics) window.camera_state += step.head<kCameraDim>();
  Index at = kCameraDim;
  for (Keyframe& keyframe : window.keyframes) {
    keyframe.state += step.segment<kFrameDim>(at);
    at += kFrameDim;
  }
  for (std::size_t i = 0; i < points_.size(); ++i) {
    WindowPoint& point = window.keyframes[points_[i].keyframe].points[points_[i].point];
    point.inverse_depth += static_cast<float>(depth_step[static_cast<Index>(i)]);
  }
  return true;
}

bool WindowOptimizer::isSmall(const Window& window, const VectorXd& step) const {
  double a = 0, b = 0, rotation = 0, translation = 0, depths = 0;
  for (Index at = kCameraDim; at < step.size(); at += kFrameDim) {
    translation += step.segment<3>(at).squaredNorm();
    rotation += step.segment<3>(at + 3).squaredNorm();
    a += step[at + 6] * step[at + 6];
    b += step[at + 7] * step[at + 7];
  }
  for (const Keyframe& keyframe : window.keyframes) {
    for (const WindowPoint& point : keyframe.points) {
      depths += std::abs(static_cast<double>(point.inverse_depth));
    }
  }
  const auto frames = static_cast<double>(window.keyframes.size());
  const double mean_depth = points_.empty() ? 0 : depths / static_cast<double>(points_.size());
  return std::sqrt(a / frames) < kSlack * kSmallA && std::sqrt(b / frames) < kSlack * kSmallB &&
         std::sqrt(rotation / frames) < kSlack * kSmallRotation &&
         std::sqrt(translation / frames) * mean_depth < kSlack * kSmallTranslation;
}

/// One step. @return whether to go on
bool WindowOptimizer::iterate(Window& window,
                              PairTable& pairs,
                              int iteration,
                              OptimizationReport& report) {
  VectorXd step = solveStep(window, current_, options_, damping_);
  if (iteration >= kNullSpaceFrom) step = withoutGauge(step, gauge_);
  save(window);
  if (!applyStep(window, step, damping_)) {
    report.finite = false;
    return false;
  }
  ++report.iterations;
  const double energy = evaluate(window, pairs, trial_);
  const bool keep =
      std::isfinite(energy) && (!options_.optimizer.undo_bad_steps || energy <= energy_);
  if (!keep) {
    restore(window);
    pairs.refreshCurrent(window);
    ++report.undone_steps;
    report.finite = std::isfinite(energy) || options_.optimizer.undo_bad_steps;
    damping_ = std::max(damping_ * kDampingOnFailure, kMinDampingOnFailure);
    return report.finite && report.undone_steps < kMaxUndone && !isSmall(window, step);
  }
  if (!options_.optimizer.fixed_thresholds) adaptNewestThreshold(window);
  commit(window);
  std::swap(current_, trial_);
  energy_ = energy;
  if (options_.optimizer.undo_bad_steps) damping_ *= kDampingOnSuccess;
  report.converged = iteration >= 1 && isSmall(window, step);
  return !report.converged;
}

void WindowOptimizer::finish(Window& window, OptimizationReport& report) {
  for (std::size_t i = 0; i < points_.size(); ++i) {
    const float curvature = current_.depth_curvature[static_cast<Index>(i)];
    window.keyframes[points_[i].keyframe].points[points_[i].point].information = curvature;
  }
  report.residuals = current_.used;
  report.last_energy = energy_;
  report.rms = std::sqrt(current_.energy / (kPatternSize * std::max(1, current_.used)));
  window.keyframes.back().moveFirstEstimate();
  PairTable pairs(window);
  evaluate(window, pairs, trial_);
  commit(window);
  adaptNewestThreshold(window);
  for (std::size_t host = 0; host < window.keyframes.size(); ++host) {
    for (WindowPoint& point : window.keyframes[host].points) {
      closePoint(point, window, pairs, host);
    }
  }
}

OptimizationReport WindowOptimizer::optimize(Window& window) {
  if (window.keyframes.size() < 2) {
    throw std::logic_error("a window of " + std::to_string(window.keyframes.size()) +
                           " keyframes cannot be adjusted; 2 are needed");
  }
  const bool small = window.keyframes.size() < kSmallWindow;
  const int limit = small ? kMaxIterationsSmall : options_.optimizer.max_iterations;
  OptimizationReport report;
  PairTable pairs(window);
  start(window, pairs);
  report.first_energy = energy_;
  report.finite = std::isfinite(energy_);
  for (int i = 0; report.finite && i < limit; ++i) {
    if (!iterate(window, pairs, i, report)) break;
  }
  finish(window, report);
  return report;
}

}  // namespace dsorb::window
