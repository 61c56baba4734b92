// SPDX-License-Identifier: BSD-3-Clause
#include "track/pose_alignment.h"

#include "base/parallel.h"
#include "estimate/robust_loss.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>

namespace dsorb::track {
namespace {

// Constants of the damped iteration: front end of DSO as published.
constexpr double kCutoff = 20;                 // larger residuals are saturated [grey levels]
constexpr double kMaxSaturatedFraction = 0.6;  // the cut-off is doubled while more are saturated
constexpr double kInitialLambda = 0.01;
constexpr double kLambdaFloor = 0.001;  // after a rejected step; steps below it are extrapolated
constexpr double kLambdaDown = 0.5;
constexpr double kLambdaUp = 4;
constexpr double kStopNorm = 1e-3;       // of a step in scaled units
constexpr double kRotationScale = 0.5;   // [rad]
constexpr double kGainScale = 10;        // of a [-]
constexpr double kOffsetScale = 1000;    // of b [grey levels]
constexpr double kMaxCutoffFactor = 50;  // doubling ends above it
constexpr std::size_t kBlocksPerTask = 16;

std::size_t blockCount(std::size_t points) {
  return (points + kAlignmentBlock - 1) / kAlignmentBlock;
}

PointArrays at(const ReferencePoints& points, std::size_t begin) {
  return {points.ray_x.data() + begin,
          points.ray_y.data() + begin,
          points.inverse_depth.data() + begin,
          points.intensity.data() + begin};
}

AlignmentSetting makeSetting(const AlignmentLevel& level,
                             const AlignmentState& state,
                             const PinholeCamera& camera) {
  const TrackingReference& reference = level.reference;
  const PyramidLevel& image = level.frame.level(level.level);
  const BrightnessTransfer transfer = brightnessTransfer(
      reference.affine(), reference.frame().exposure(), state.affine, level.frame.exposure());
  AlignmentSetting s{};
  Eigen::Map<Eigen::Matrix<float, 3, 3, Eigen::RowMajor>>(s.R.data()) =
      state.T_frame_reference.rotationMatrix().cast<float>();
  Eigen::Map<Eigen::Vector3f>(s.t.data()) = state.T_frame_reference.translation().cast<float>();
  s.fx = static_cast<float>(camera.fx);
  s.fy = static_cast<float>(camera.fy);
  s.cx = static_cast<float>(camera.cx);
  s.cy = static_cast<float>(camera.cy);
  s.gain = static_cast<float>(transfer.gain);
  s.offset = static_cast<float>(transfer.offset);
  s.affine_b_reference = static_cast<float>(reference.affine().b);
  s.image = image.data();
  s.width = image.width();
  s.height = image.height();
  return s;
}

double scaledNorm(const Vector8d& step) {
  Vector8d scaled = step;
  scaled.segment<3>(3) /= kRotationScale;
  scaled[6] /= kGainScale;
  scaled[7] /= kOffsetScale;
  return scaled.norm();
}

}  // namespace

void PoseAlignment::resize(std::size_t points) {
  for (std::vector<float>* values : {&samples_.u,
                                     &samples_.v,
                                     &samples_.rho,
                                     &samples_.dx,
                                     &samples_.dy,
                                     &samples_.residual,
                                     &samples_.weight}) {
    values->resize(points);
  }
  block_energies_.resize(blockCount(points));
  block_sums_.resize(blockCount(points));
}

Evaluation PoseAlignment::evaluate(const AlignmentLevel& level,
                                   const AlignmentState& state,
                                   double cutoff) {
  points_ = &level.reference.points(level.level);
  setting_ = makeSetting(level, state, camera_.atLevel(level.level));
  setting_.huber_threshold = kHuberThreshold;
  setting_.cutoff = static_cast<float>(cutoff);
  resize(points_->size());
  forEachRange(block_energies_.size(), kBlocksPerTask, [&](std::size_t begin, std::size_t end) {
    for (std::size_t block = begin; block < end; ++block) {
      const std::size_t first = block * kAlignmentBlock;
      const std::size_t count = std::min(kAlignmentBlock, points_->size() - first);
      block_energies_[block] =
          evaluateBlock(setting_, at(*points_, first), samplesFrom(first), count);
    }
  });
  Evaluation sum;
  for (const BlockEnergy& block : block_energies_) {
    sum.energy += static_cast<double>(block.energy);
    sum.used += block.used;
    sum.saturated += block.saturated;
  }
  return sum;
}

SampleArrays PoseAlignment::samplesFrom(std::size_t first) {
  return {samples_.u.data() + first,
          samples_.v.data() + first,
          samples_.rho.data() + first,
          samples_.dx.data() + first,
          samples_.dy.data() + first,
          samples_.residual.data() + first,
          samples_.weight.data() + first};
}

NormalEquations PoseAlignment::normalEquations() {
  forEachRange(block_sums_.size(), kBlocksPerTask, [&](std::size_t begin, std::size_t end) {
    for (std::size_t block = begin; block < end; ++block) {
      const std::size_t first = block * kAlignmentBlock;
      const std::size_t count = std::min(kAlignmentBlock, points_->size() - first);
      accumulateBlock(setting_, at(*points_, first), samplesFrom(first), count, block_sums_[block]);
    }
  });
  std::array<double, kAlignmentSums> total{};
  for (const auto& block : block_sums_) {
    for (std::size_t i = 0; i < kAlignmentSums; ++i) total[i] += static_cast<double>(block[i]);
  }
  NormalEquations system;
  const double* next = total.data();
  for (int row = 0; row < kAlignmentParameters; ++row) {
    for (int column = row; column < kAlignmentParameters; ++column) {
      system.H(row, column) = system.H(column, row) = *next++;
    }
    system.b[row] = *next++;
  }
  return system;
}

Evaluation PoseAlignment::evaluateRaisingCutoff(const AlignmentLevel& level,
                                                const AlignmentState& state,
                                                double& cutoff) {
  Evaluation evaluation = evaluate(level, state, cutoff);
  while (evaluation.saturatedFraction() > kMaxSaturatedFraction &&
         cutoff < kMaxCutoffFactor * kCutoff) {
    cutoff *= 2;
    evaluation = evaluate(level, state, cutoff);
  }
  return evaluation;
}

Vector8d PoseAlignment::dampedStep(const NormalEquations& system, double lambda) const {
  Matrix8d H = system.H;
  H.diagonal() *= 1.0 + lambda;
  Vector8d step = Vector8d::Zero();
  if (brightness_ == BrightnessModel::kPerfect) {
    step.head<6>() = -H.topLeftCorner<6, 6>().ldlt().solve(system.b.head<6>());
  } else {
    step = -H.ldlt().solve(system.b);
  }
  if (lambda < kLambdaFloor) step *= std::pow(kLambdaFloor / lambda, 0.25);
  return step;
}

LevelResult PoseAlignment::align(const AlignmentLevel& level,
                                 int max_iterations,
                                 AlignmentState& state) {
  double cutoff = kCutoff;
  Evaluation current = evaluateRaisingCutoff(level, state, cutoff);
  NormalEquations system = normalEquations();
  double lambda = kInitialLambda;
  LevelResult result;
  while (result.iterations < max_iterations) {
    ++result.iterations;
    const Vector8d step = dampedStep(system, lambda);
    if (!step.allFinite()) break;
    const AlignmentState trial = state.plus(step);
    const Evaluation evaluation = evaluate(level, trial, cutoff);
    if (evaluation.meanEnergy() < current.meanEnergy()) {
      state = trial;
      current = evaluation;
      system = normalEquations();
      lambda *= kLambdaDown;
    } else {
      lambda = std::max(kLambdaUp * lambda, kLambdaFloor);
    }
    if (scaledNorm(step) <= kStopNorm) break;
  }
  result.rmse = std::sqrt(current.meanEnergy());
  result.saturated_fraction = current.saturatedFraction();
  result.inside_fraction =
      static_cast<double>(current.used) /
      static_cast<double>(std::max<std::size_t>(level.reference.points(level.level).size(), 1));
  result.cutoff_raised = cutoff > kCutoff;
  return result;
}

}  // namespace dsorb::track
