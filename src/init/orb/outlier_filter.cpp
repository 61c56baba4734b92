// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/outlier_filter.h"

#include "base/median.h"
#include "init/orb/neighbour_disagreement.h"
#include "init/orb/photometric_covariance.h"
#include "init/orb/photometric_problem.h"
#include "init/orb/residual_statistics.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace dsorb::init_orb {
namespace {

/// Every pixel of every patch that takes part in a frame.
std::vector<double> pixelsOf(const FrameResiduals& patches) {
  std::vector<double> pixels;
  pixels.reserve(patches.size() * kPatternSize);
  for (const auto& patch : patches) {
    if (patch) pixels.insert(pixels.end(), patch->data(), patch->data() + kPatternSize);
  }
  return pixels;
}

/// By patch: whether it is to go.
using Verdicts = std::vector<char>;

Verdicts votePixels(const PhotometricProblem& problem,
                    const std::vector<FrameResiduals>& residuals,
                    const OutlierOptions& options,
                    OutlierReport& report) {
  std::vector<int> remaining(problem.patches.size(), 0);
  std::vector<double> scales;
  for (const FrameResiduals& frame : residuals) {
    const double scale = fitTDistribution(pixelsOf(frame), options.prefilter).scale;
    scales.push_back(scale);
    const double cut = options.t_quantile * scale;
    for (std::size_t i = 0; i < frame.size(); ++i) {
      if (!frame[i]) continue;
      const auto out = (frame[i]->array().abs() >= cut).count();
      remaining[i] += 2 * out > kPatternSize ? 0 : 1;
    }
  }
  report.t_scale = medianOf(scales);
  const int needed = std::min(options.min_observations, static_cast<int>(residuals.size()));
  Verdicts verdicts(remaining.size());
  std::transform(remaining.begin(), remaining.end(), verdicts.begin(), [needed](int count) {
    return static_cast<char>(count < needed ? 1 : 0);
  });
  return verdicts;
}

/// How the noise of a residual grows with the gradient: variance s_n^2 + s_x^2 |gradient|^2.
struct NoiseModel {
  double grey_variance = 1;      ///< s_n^2 [grey levels^2]
  double position_variance = 0;  ///< s_x^2 [px^2]

  [[nodiscard]] double variance(double squared_gradient) const {
    return grey_variance + position_variance * squared_gradient;
  }
};

double squaredGradient(const PatchGradients& gradients, std::size_t pixel) {
  const auto x = static_cast<double>(gradients.x[pixel]);
  const auto y = static_cast<double>(gradients.y[pixel]);
  return x * x + y * y;
}

/// Residuals of weak and of strong gradients, and what follows from their medians.
/// @source experiments on rendered and real sequences, section A5
NoiseModel fitNoise(const std::vector<FrameResiduals>& residuals,
                    const std::vector<PatchGradients>& gradients) {
  constexpr double kWeak = 20;        // [grey levels / px]
  constexpr double kStrong = 40;      // [grey levels / px]
  constexpr double kMinVariance = 1;  // of grey values [grey levels^2]
  struct Class {
    std::vector<double> magnitudes;
    double gradient_sum = 0;
    [[nodiscard]] double gradient() const {
      return gradient_sum / std::max<double>(1, static_cast<double>(magnitudes.size()));
    }
  };
  Class weak;
  Class strong;
  for (const FrameResiduals& frame : residuals) {
    for (std::size_t i = 0; i < frame.size(); ++i) {
      for (std::size_t j = 0; frame[i] && j < kPattern.size(); ++j) {
        const double gradient = std::sqrt(squaredGradient(gradients[i], j));
        if (gradient >= kWeak && gradient <= kStrong) continue;
        Class& into = gradient < kWeak ? weak : strong;
        into.magnitudes.push_back(std::abs((*frame[i])[static_cast<Eigen::Index>(j)]));
        into.gradient_sum += gradient;
      }
    }
  }
  NoiseModel noise;
  const double a = kMadToSigma * medianOf(weak.magnitudes);
  const double b = kMadToSigma * medianOf(strong.magnitudes);
  const double weak_gradient = weak.gradient();
  const double strong_gradient = strong.gradient();
  const double span = strong_gradient * strong_gradient - weak_gradient * weak_gradient;
  if (span > 0 && !weak.magnitudes.empty()) {
    noise.position_variance = std::max(0.0, (b * b - a * a) / span);
  }
  noise.grey_variance =
      std::max(kMinVariance, a * a - noise.position_variance * weak_gradient * weak_gradient);
  return noise;
}

/// Mean t-weight of each patch over all its pixels and frames, residuals divided by what their
/// gradients let expect; 0 for a patch that takes part nowhere.
std::vector<double> meanWeights(const PhotometricProblem& problem,
                                std::vector<FrameResiduals> residuals,
                                const std::vector<PatchGradients>& gradients,
                                const OutlierOptions& options) {
  const NoiseModel noise = fitNoise(residuals, gradients);
  std::vector<double> sums(problem.patches.size(), 0.0);
  std::vector<int> counts(problem.patches.size(), 0);
  for (FrameResiduals& frame : residuals) {
    for (std::size_t i = 0; i < frame.size(); ++i) {
      for (std::size_t j = 0; frame[i] && j < kPattern.size(); ++j) {
        (*frame[i])[static_cast<Eigen::Index>(j)] /=
            std::sqrt(noise.variance(squaredGradient(gradients[i], j)));
      }
    }
    const double scale = fitTDistribution(pixelsOf(frame), options.prefilter).scale;
    if (!(scale > 0)) continue;
    for (std::size_t i = 0; i < frame.size(); ++i) {
      if (!frame[i]) continue;
      for (const double residual : *frame[i]) sums[i] += tWeight(residual, scale) / kPatternSize;
      ++counts[i];
    }
  }
  for (std::size_t i = 0; i < sums.size(); ++i) sums[i] /= std::max(counts[i], 1);
  return sums;
}

/// Predicted sigma, neighbours and residuals together: on weak texture residuals do not show a
/// wrong depth, at occlusions they do.
Verdicts combine(const PhotometricProblem& problem,
                 const PhotometricState& state,
                 const std::vector<double>& weights,
                 const PhotometricUncertainty& uncertainty,
                 const OutlierOptions& options) {
  std::vector<Eigen::Vector2f> pixels;
  pixels.reserve(problem.patches.size());
  const PinholeCamera& camera = problem.camera;
  for (const HostPatch& patch : problem.patches) {
    const Eigen::Vector3d ray = patch.ray.cast<double>().homogeneous();
    pixels.emplace_back(camera.project(ray).cast<float>());
  }
  const std::vector<double> disagreement = neighbourDisagreement(pixels, state.inverse_depth);
  Verdicts verdicts(problem.patches.size(), 0);
  for (std::size_t i = 0; i < verdicts.size(); ++i) {
    const double rho = state.inverse_depth[i];
    const double limit = options.max_relative_sigma * rho;
    const bool sharp =
        !uncertainty.usable || (uncertainty.formal[static_cast<Eigen::Index>(i)] > 0 &&
                                uncertainty.formal[static_cast<Eigen::Index>(i)] <= limit * limit);
    const bool good = rho > 0 && sharp && disagreement[i] <= options.max_disagreement &&
                      weights[i] >= options.min_t_weight;
    verdicts[i] = good ? 0 : 1;
  }
  return verdicts;
}

/// Drops corners, with their observations, and semi-dense points.
void removeFrom(InitialMap& map,
                const PhotometricProblem& problem,
                const Verdicts& verdicts,
                OutlierReport& report) {
  const std::size_t corners = map.corners.size();
  std::vector<char> gone(corners + map.points.size(), 0);
  for (std::size_t i = 0; i < verdicts.size(); ++i) gone[problem.source[i]] = verdicts[i];
  const auto first_point = gone.begin() + static_cast<std::ptrdiff_t>(corners);
  removeCorners(map, {gone.begin(), first_point});
  std::size_t point = 0;
  for (std::size_t i = 0; i < map.points.size(); ++i) {
    if (gone[corners + i] == 0) map.points[point++] = map.points[i];
  }
  report.examined = static_cast<int>(gone.size());
  report.removed_corners = static_cast<int>(corners - map.corners.size());
  report.removed_points = static_cast<int>(map.points.size() - point);
  map.points.resize(point);
}

}  // namespace

OutlierReport removeOutliers(InitialMap& map,
                             const PinholeCamera& camera,
                             const PhotometricOptions& photometric,
                             const OutlierOptions& options) {
  OutlierReport report;
  if (options.rule == OutlierRule::kNone) return report;
  const std::vector<std::size_t> frames = spreadFrames(map, photometric.max_frames);
  PhotometricProblem problem = makeProblem(map, camera, frames, 0, photometric.gradient_weights);
  const PhotometricState state = makeState(problem, map);
  std::vector<FrameResiduals> residuals;
  for (std::size_t f = 0; f < frames.size(); ++f) {
    residuals.push_back(residualsIn(problem, state, f, photometric.brightness));
  }
  const Verdicts votes = votePixels(problem, residuals, options, report);
  if (options.rule == OutlierRule::kPixelVotes) {
    removeFrom(map, problem, votes, report);
    return report;
  }
  const PyramidLevel& reference = map.frames.front()->level(0);
  findVisible(problem, state);
  const PhotometricUncertainty uncertainty =
      estimateUncertainty(problem, state, reference, photometric);
  const std::vector<double> weights =
      meanWeights(problem, std::move(residuals), hostGradients(problem, reference), options);
  removeFrom(map, problem, combine(problem, state, weights, uncertainty, options), report);
  return report;
}

}  // namespace dsorb::init_orb
