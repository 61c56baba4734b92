// SPDX-License-Identifier: BSD-3-Clause
#include "depth/candidate_activation.h"

#include "base/target_clones.h"
#include "estimate/robust_loss.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

namespace dsorb::depth {
namespace {

// What a candidate needs to become a point of the window, as published with DSO.
constexpr float kMinQuality = 3;        // second best over best energy of the last long search
constexpr float kMaxInterval = 8;       // [px] uncertainty along the epipolar line
constexpr int kIterations = 3;          // of the depth alone, before activation
constexpr float kMinInformation = 100;  // [grey^2 unit^2] curvature of the energy a depth needs
constexpr int kMinObservations = 1;     // good residuals a depth needs

constexpr float kInitialDamping = 0.1F;  // of the depth fit, and its factors below
constexpr float kDampingOnSuccess = 0.5F;
constexpr float kDampingOnFailure = 5.0F;
constexpr float kRelativeStop = 1e-4F;  // of a step
constexpr float kLooseLimit = 1000.0F;  // factor on the first outlier limit (reference)

enum class FitState : std::uint8_t { kIn, kOutOfBounds, kOutlier };

/// Energy of the pattern with its derivatives by the inverse depth, of one target or several.
struct FitSums {
  float energy = 0;
  float curvature = 0;
  float gradient = 0;
  int inliers = 0;
};

/// @return nothing where the pattern cannot be seen
template <bool kRolling>
DSORB_ALWAYS_INLINE std::optional<FitSums> evaluateTarget(const CandidatePoint& candidate,
                                                          const HostRays& rays,
                                                          const TargetImage& target,
                                                          float inverse_depth) {
  WarpedPattern pattern;
  warpPattern<kRolling>(target, rays, candidate.patch.pixel, inverse_depth, pattern);
  if (!inAllLanes(pattern.inside)) return std::nullopt;
  Lanes weight;
  Lanes residual;
  Lanes huber;
  load(candidate.patch.root_weight.data(), weight);
  patternResidual(target, candidate.patch, pattern.seen, residual);
  huberWeights(residual, huber);
  Lanes flow_x;
  Lanes flow_y;
  depthFlow(target.warp, pattern.at, flow_x, flow_y);
  const Lanes slope = pattern.seen.dx * flow_x + pattern.seen.dy * flow_y;
  const Lanes w = weight * weight * huber;
  Lanes energies;
  huberEnergies(residual, huber, w, energies);
  const float energy = sumLanes(energies);
  if (!std::isfinite(energy)) return std::nullopt;
  return FitSums{energy, sumLanes(w * slope * slope), sumLanes(w * slope * residual), 0};
}

/// A depth to try.
struct HypotheticalDepth {
  float inverse;         // [1/unit]
  float outlier_energy;  // of a target
};

/// Sum over all targets; `states` remembers which left the image for good.
template <bool kRolling>
DSORB_ALWAYS_INLINE FitSums sumTargets(const CandidatePoint& candidate,
                                       const HostRays& rays,
                                       const std::vector<TargetImage>& targets,
                                       const HypotheticalDepth& depth,
                                       std::vector<FitState>& states) {
  FitSums sum;
  for (std::size_t i = 0; i < targets.size(); ++i) {
    if (states[i] == FitState::kOutOfBounds) continue;
    const auto terms = evaluateTarget<kRolling>(candidate, rays, targets[i], depth.inverse);
    if (!terms) {
      states[i] = FitState::kOutOfBounds;
      continue;
    }
    const bool outlier = terms->energy > depth.outlier_energy;
    states[i] = outlier ? FitState::kOutlier : FitState::kIn;
    sum.inliers += outlier ? 0 : 1;
    sum.energy += std::min(terms->energy, depth.outlier_energy);
    sum.curvature += terms->curvature;
    sum.gradient += terms->gradient;
  }
  return sum;
}

DSORB_TARGET_CLONES FitSums evaluateGlobal(const CandidatePoint& candidate,
                                           const HostRays& rays,
                                           const std::vector<TargetImage>& targets,
                                           const HypotheticalDepth& depth,
                                           std::vector<FitState>& states) {
  return sumTargets<false>(candidate, rays, targets, depth, states);
}

DSORB_TARGET_CLONES FitSums evaluateRolling(const CandidatePoint& candidate,
                                            const HostRays& rays,
                                            const std::vector<TargetImage>& targets,
                                            const HypotheticalDepth& depth,
                                            std::vector<FitState>& states) {
  return sumTargets<true>(candidate, rays, targets, depth, states);
}

}  // namespace

DistanceMap::DistanceMap(int width, int height, int reach)
    : width_(width),
      height_(height),
      reach_(reach),
      cells_(static_cast<std::size_t>(width) * static_cast<std::size_t>(height), kFar) {
  // One more than there are: growStep() writes before it knows.
  for (Front* front : {&front_, &next_}) front->cells.reset(new Cell[cells_.size() + 1]);
}

void DistanceMap::growStep(int distance) {
  static constexpr std::array<std::array<int, 2>, 8> kNeighbours = {
      {{1, 0}, {-1, 0}, {0, 1}, {0, -1}, {1, 1}, {1, -1}, {-1, 1}, {-1, -1}}};
  const std::size_t count = distance % 2 == 1 ? 8 : 4;
  Cell* reached = next_.cells.get();
  for (std::size_t i = 0; i < front_.size; ++i) {
    const Cell& cell = front_.cells[i];
    const bool border = cell.x == 0 || cell.y == 0 || cell.x == width_ - 1 || cell.y == height_ - 1;
    if (border) continue;
    for (std::size_t n = 0; n < count; ++n) {  // without a branch, which nobody could predict
      const auto [dx, dy] = kNeighbours[n];
      *reached = {cell.index + dy * width_ + dx, cell.x + dx, cell.y + dy};
      std::uint16_t& value = cells_[static_cast<std::size_t>(reached->index)];
      const bool nearer = value > distance;
      value = nearer ? static_cast<std::uint16_t>(distance) : value;
      reached += nearer ? 1 : 0;
    }
  }
  next_.size = static_cast<std::size_t>(reached - next_.cells.get());
  std::swap(front_, next_);
}

void DistanceMap::add(const std::vector<Eigen::Vector2i>& seeds) {
  front_.size = 0;
  for (const Eigen::Vector2i& seed : seeds) {
    std::uint16_t& value = cells_[index(seed.x(), seed.y())];
    if (value == 0) continue;  // grown from already
    value = 0;
    front_.cells[front_.size++] = {
        static_cast<std::int32_t>(index(seed.x(), seed.y())), seed.x(), seed.y()};
  }
  for (int distance = 1; distance <= reach_ && front_.size > 0; ++distance) growStep(distance);
}

double adaptDistance(double distance, int active, int desired, double max_distance) {
  const double ratio = static_cast<double>(active) / desired;
  if (ratio < 0.66) distance -= 0.8;
  if (ratio < 0.8) {
    distance -= 0.5;
  } else if (ratio < 0.9) {
    distance -= 0.2;
  } else if (ratio < 1.0) {
    distance -= 0.1;
  }
  if (ratio > 1.5) distance += 0.8;
  if (ratio > 1.3) distance += 0.5;
  if (ratio > 1.15) distance += 0.2;
  if (ratio > 1.0) distance += 0.1;
  return std::clamp(distance, 0.0, max_distance);
}

CandidateVerdict judgeCandidate(const CandidatePoint& candidate, bool host_leaves) {
  if (!candidate.hasDepth() || candidate.status == CandidateStatus::kOutlier) {
    return CandidateVerdict::kDrop;
  }
  const bool ready = candidate.status != CandidateStatus::kUninitialized &&
                     candidate.interval < kMaxInterval && candidate.quality > kMinQuality &&
                     candidate.middle() > 0;
  if (ready) return CandidateVerdict::kReady;
  return host_leaves || candidate.finished ? CandidateVerdict::kDrop : CandidateVerdict::kWait;
}

DepthFit fitDepth(const CandidatePoint& candidate,
                  const HostRays& rays,
                  const std::vector<TargetImage>& targets,
                  const DepthOptions& options) {
  const CandidateVerdict weak =
      candidate.finished ? CandidateVerdict::kDrop : CandidateVerdict::kWait;
  const float first_limit = kPatternOutlierEnergy * (options.consistent_energy ? 1 : kLooseLimit);
  const bool rolling = !targets.empty() && targets.front().corrected;
  const auto evaluate_all = rolling ? evaluateRolling : evaluateGlobal;
  std::vector<FitState> states(targets.size(), FitState::kIn);
  float depth = candidate.middle();
  FitSums terms = evaluate_all(candidate, rays, targets, {depth, first_limit}, states);
  DepthFit fit;
  fit.verdict = weak;
  if (!std::isfinite(terms.energy) || terms.curvature < kMinInformation) return fit;
  // One number, which every trial may end for good: minimize() would need more around it than this.
  float damping = kInitialDamping;
  for (int i = 0; i < kIterations; ++i) {
    const float step = terms.gradient / ((1 + damping) * terms.curvature);
    std::vector<FitState> trial_states = states;
    const FitSums trial =
        evaluate_all(candidate, rays, targets, {depth - step, kPatternOutlierEnergy}, trial_states);
    if (!std::isfinite(trial.energy) || trial.curvature < kMinInformation) return fit;
    if (trial.energy < terms.energy) {
      depth -= step;
      terms = trial;
      states = std::move(trial_states);
      damping *= kDampingOnSuccess;
    } else {
      damping *= kDampingOnFailure;
    }
    if (std::abs(step) < kRelativeStop * depth) break;
  }
  const bool good = std::isfinite(depth) && terms.inliers >= kMinObservations;
  fit.verdict = good ? CandidateVerdict::kReady : CandidateVerdict::kDrop;
  fit.inverse_depth = depth;
  fit.information = terms.curvature;
  for (const FitState state : states) fit.seen.push_back(state == FitState::kIn);
  return fit;
}

}  // namespace dsorb::depth
