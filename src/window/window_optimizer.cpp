// SPDX-License-Identifier: BSD-3-Clause
#include "window/window_optimizer.h"

#include "base/median.h"
#include "estimate/levenberg_marquardt.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <stdexcept>
#include <string>
#include <utility>

namespace dsorb::window {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr int kMaxIterations = 6;        // of one adjustment. @source DSO as published
constexpr std::size_t kSmallWindow = 4;  // fewer keyframes get more iterations
constexpr int kMaxIterationsSmall = 15;  // while the window is small. @source DSO as published
constexpr int kNullSpaceFrom =
    2;  // first iteration whose step has gauge motion removed; as published
constexpr FactorDamping kDamping{1e-5, 0.25, 100, 0, 1e-2};  // @source DSO as published
constexpr int kMaxUndone = 3;  // steps undone in one adjustment; then the iteration ends

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

double marginalEnergy(const Window& window) {
  const VectorXd d = window.deviation();
  return d.dot(window.prior.H * d) + 2 * window.prior.b.dot(d);
}

/// Mean energy of a pixel of the residuals in use [grey levels^2].
double squaredRms(const WindowEquations& equations) {
  return equations.energy / (kPatternSize * std::max(1, equations.used));
}

template <typename Function>
void forEachObservation(Window& window, const Function& function) {
  for (Keyframe& keyframe : window.keyframes) {
    for (WindowPoint& point : keyframe.points) {
      for (Observation& observation : point) function(observation);
    }
  }
}

void commit(Window& window) {
  forEachObservation(window, [](Observation& observation) {
    observation.state = observation.trial_state;
    observation.energy = observation.trial_energy;
  });
}

void resetResiduals(Window& window) {
  forEachObservation(window, [](Observation& observation) {
    observation.state = ResidualState::kIn;
    observation.energy = 0;
  });
}

/// Notes the final evaluation in one point and removes unused residuals.
void closePoint(WindowPoint& point, const Window& window) {
  for (const Observation& observation : point) {
    const KeyframeId target = window.keyframes[observation.target].id;
    for (RecentState& recent : point.recent) {
      if (recent.keyframe == target) recent.state = observation.state;
    }
    if (observation.state == ResidualState::kIn) ++point.good_observations;
  }
  point.removeObservations([](const Observation& o) { return o.state != ResidualState::kIn; });
}

}  // namespace

void adaptThresholds(std::size_t first, Window& window) {
  std::vector<std::vector<float>> energies(window.keyframes.size());
  forEachObservation(window, [&](const Observation& observation) {
    if (observation.trial_state == ResidualState::kOutOfBounds) return;
    energies[observation.target].push_back(observation.trial_raw);
  });
  for (std::size_t k = first; k < energies.size(); ++k) {
    float& threshold = window.keyframes[k].energy_threshold;
    if (energies[k].empty()) {
      threshold = kPatternOutlierEnergy;
      continue;
    }
    const float root =
        kThresholdConstant +
        kThresholdFactor * std::sqrt(quantileInPlace(energies[k], kThresholdQuantile));
    threshold = root * root;
  }
}

WindowOptimizer::WindowOptimizer(const WindowOptions& options) : options_(options) {
  linearize_.depth_prior_pulls = !options.published;
}

/// One adjustment, for minimize().
class WindowOptimizer::Adjustment {
 public:
  /// @param first_threshold position of the first keyframe whose outlier threshold is adapted
  Adjustment(WindowOptimizer& memory, Window& window, std::size_t first_threshold)
      : memory_(memory),
        options_(memory.options_),
        window_(window),
        first_threshold_(first_threshold),
        pairs_(window),
        points_(allPoints(window)),
        gauge_(gaugeDirections(window)),
        camera_(estimatedCamera(window, memory.options_)) {
    memory_.linearize_.camera = camera_;
    window_.velocities_held = window_.mayBeGlobal();
    resetResiduals(window_);
    if (!options_.published) adaptThreshold();
    energy_ = evaluate(memory_.current_);
    if (options_.published) adaptThresholds(first_threshold_, window_);
    commit(window_);
    report_.first_energy = energy_;
    report_.finite = std::isfinite(energy_);
  }

  std::optional<double> solve(double damping) {
    const StateStep step =
        solveStep(window_, memory_.current_, memory_.options_, damping, memory_.elimination_);
    step_ = step.change;
    if (report_.iterations >= kNullSpaceFrom) step_ = withoutGauge(step_, gauge_);
    // Beyond what the depths alone gain. A state that is off by its standard deviation raises the
    // energy by the variance of a residual.
    const double decrease = -step.gradient.dot(step_);
    const double variances = static_cast<double>(step_.size()) * squaredRms(memory_.current_);
    negligible_ = options_.optimizer.min_decrease > 0 &&
                  decrease < options_.optimizer.min_decrease * variances;
    memory_.elimination_.substituteBack(memory_.current_, step_, depth_step_);
    const bool finite =
        step_.allFinite() && std::all_of(depth_step_.begin(), depth_step_.end(), [](double depth) {
          return std::isfinite(depth);
        });
    return finite ? std::optional(decrease) : std::nullopt;
  }

  std::optional<double> tryStep() {
    ++report_.iterations;
    save();
    applyStep();
    report_.converged = negligible_;
    if (negligible_) return 0;
    trial_energy_ = evaluate(memory_.trial_);
    const bool keep =
        std::isfinite(trial_energy_) && (options_.published || trial_energy_ <= energy_);
    return keep ? std::optional(energy_ - trial_energy_) : std::nullopt;
  }

  bool accept(const DampedStep& /*step*/) {
    if (report_.converged) return false;
    if (options_.published) adaptThresholds(first_threshold_, window_);
    commit(window_);
    std::swap(memory_.current_, memory_.trial_);
    energy_ = trial_energy_;
    report_.converged = report_.iterations > 1 && isSmall();
    return !report_.converged;
  }

  bool reject(const DampedStep& step) {
    if (!step.predicted) {
      report_.finite = false;
      return false;
    }
    restore();
    ++report_.undone_steps;
    report_.finite = std::isfinite(trial_energy_) || !options_.published;
    return report_.finite && report_.undone_steps < kMaxUndone && !isSmall();
  }

  OptimizationReport finish();
  [[nodiscard]] bool finite() const { return report_.finite; }

 private:
  double evaluate(WindowEquations& equations) {
    placePoints(window_);
    pairs_.refreshCurrent(window_);
    memory_.builder_.build(window_, pairs_, points_, memory_.linearize_, equations);
    return equations.energy + equations.depth_prior_energy + marginalEnergy(window_) +
           statePrior(window_, memory_.options_).energy;
  }
  /// Thresholds by the residuals at the state for which pairs_ was made.
  void adaptThreshold() {
    placePoints(window_);
    evaluateFrom(first_threshold_, window_, pairs_, points_);
    adaptThresholds(first_threshold_, window_);
  }
  WindowPoint& at(std::size_t i) {
    return window_.keyframes[points_[i].keyframe].points[points_[i].point];
  }
  void applyStep();
  void save();
  void restore();
  [[nodiscard]] bool isSmall() const;

  WindowOptimizer& memory_;
  const WindowOptions& options_;
  Window& window_;
  std::size_t first_threshold_;
  PairTable pairs_;
  std::vector<PointRef> points_;
  MatrixXd gauge_;
  EstimatedCamera camera_;
  OptimizationReport report_;
  VectorXd step_;
  std::vector<double> depth_step_;
  double energy_ = 0;
  double trial_energy_ = 0;
  bool negligible_ = false;  // what the step would gain
  // The state before a step.
  CameraVector camera_state_;
  std::vector<Vector8d> states_;
  std::vector<Vector6d> velocities_;
  std::vector<float> inverse_depths_;
};

void WindowOptimizer::Adjustment::save() {
  camera_state_ = window_.camera_state;
  states_.clear();
  velocities_.clear();
  inverse_depths_.clear();
  for (const Keyframe& keyframe : window_.keyframes) {
    states_.push_back(keyframe.state);
    velocities_.push_back(keyframe.motion.velocity);
  }
  for (std::size_t i = 0; i < points_.size(); ++i) inverse_depths_.push_back(at(i).inverse_depth);
}

void WindowOptimizer::Adjustment::restore() {
  window_.camera_state = camera_state_;
  for (std::size_t k = 0; k < states_.size(); ++k) {
    window_.keyframes[k].state = states_[k];
    window_.keyframes[k].motion.velocity = velocities_[k];
  }
  for (std::size_t i = 0; i < points_.size(); ++i) at(i).inverse_depth = inverse_depths_[i];
  for (Keyframe& keyframe : window_.keyframes) {
    if (window_.shutter(keyframe)) continue;  // placePoints() comes
    for (WindowPoint& point : keyframe.points) point.patch.pixel = point.patch.seen;
  }
}

void WindowOptimizer::Adjustment::applyStep() {
  if (camera_.any()) window_.camera_state += step_.head<kCameraDim>();
  for (std::size_t k = 0; k < window_.keyframes.size(); ++k) {
    Keyframe& keyframe = window_.keyframes[k];
    const Index row = window_.rowOf(k);
    keyframe.state += step_.segment<kFrameDim>(row);
    if (!window_.hasVelocities()) continue;
    keyframe.motion.velocity +=
        velocityScale().cwiseProduct(step_.segment<kVelocityDim>(row + kFrameDim));
  }
  for (std::size_t i = 0; i < points_.size(); ++i) {
    at(i).inverse_depth += static_cast<float>(depth_step_[i]);
  }
}

bool WindowOptimizer::Adjustment::isSmall() const {
  double a = 0, b = 0, rotation = 0, translation = 0, depths = 0;
  for (Index row = kCameraDim; row < step_.size(); row += window_.frameDimension()) {
    translation += step_.segment<3>(row).squaredNorm();
    rotation += step_.segment<3>(row + 3).squaredNorm();
    a += step_[row + 6] * step_[row + 6];
    b += step_[row + 7] * step_[row + 7];
  }
  for (const Keyframe& keyframe : window_.keyframes) {
    for (const WindowPoint& point : keyframe.points) {
      depths += std::abs(static_cast<double>(point.inverse_depth));
    }
  }
  const auto frames = static_cast<double>(window_.keyframes.size());
  const double mean_depth = points_.empty() ? 0 : depths / static_cast<double>(points_.size());
  return std::sqrt(a / frames) < kSlack * kSmallA && std::sqrt(b / frames) < kSlack * kSmallB &&
         std::sqrt(rotation / frames) < kSlack * kSmallRotation &&
         std::sqrt(translation / frames) * mean_depth < kSlack * kSmallTranslation;
}

/// Moves the first estimates of the newest keyframe and of those of which the marginal prior knows
/// nothing yet, as after a start: there it costs no consistency.
void moveFirstEstimates(Window& window) {
  for (std::size_t k = 0; k < window.keyframes.size(); ++k) {
    Keyframe& keyframe = window.keyframes[k];
    const Index row = window.rowOf(k);
    const bool newest = k + 1 == window.keyframes.size();
    const bool held = !keyframe.prior.head<6>().isZero(0);
    if (newest || (!held && window.prior.H.middleRows(row, window.frameDimension()).isZero(0))) {
      keyframe.moveFirstEstimate();
    }
  }
}

OptimizationReport WindowOptimizer::Adjustment::finish() {
  const WindowEquations& last = memory_.current_;
  report_.residuals = last.used;
  report_.last_energy = energy_;
  report_.rms = std::sqrt(squaredRms(last));
  report_.uncertainty =
      uncertaintyOf(window_, last, memory_.options_, report_.rms, memory_.elimination_);
  for (std::size_t i = 0; i < points_.size(); ++i) {
    at(i).information = last.depth_hessian[i];
    at(i).variance = report_.uncertainty.depth_variances[i];
  }
  if (camera_.any()) window_.readout_sigma = report_.uncertainty.camera_sigmas[kReadout];
  moveFirstEstimates(window_);
  pairs_ = PairTable(window_);
  if (!options_.published) {
    adaptThreshold();
  } else {
    evaluate(memory_.trial_);
    commit(window_);
    adaptThresholds(first_threshold_, window_);
  }
  for (Keyframe& keyframe : window_.keyframes) {
    for (WindowPoint& point : keyframe.points) closePoint(point, window_);
  }
  return report_;
}

OptimizationReport WindowOptimizer::run(Window& window, int max_iterations) {
  if (window.keyframes.size() < 2) {
    throw std::logic_error("a window of " + std::to_string(window.keyframes.size()) +
                           " keyframes cannot be adjusted; 2 are needed");
  }
  const bool steps = max_iterations > 0;
  Adjustment adjustment(*this, window, steps ? window.keyframes.size() - 1 : 0);
  FactorDamping damping = kDamping;
  if (options_.published) damping.down = 1;
  if (adjustment.finite()) minimize(adjustment, damping, max_iterations);
  return adjustment.finish();
}

OptimizationReport WindowOptimizer::optimize(Window& window) {
  const bool small = window.keyframes.size() < kSmallWindow;
  return run(window, small ? kMaxIterationsSmall : kMaxIterations);
}

OptimizationReport WindowOptimizer::assess(Window& window) {
  return run(window, 0);
}

}  // namespace dsorb::window
