// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/photometric/outlier_filter.h"

#include "base/median.h"
#include "base/parallel.h"
#include "image/image_scale.h"
#include "init/orb/photometric/neighbour_disagreement.h"
#include "init/orb/photometric/photometric_covariance.h"
#include "init/orb/photometric/photometric_problem.h"
#include "init/orb/photometric/residual_statistics.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace dsorb::init_orb {
namespace {

constexpr double kPrefilter = 3;      // residuals beyond do not enter the t-fit [1.4826 MAD]
constexpr double kTQuantile = 2.571;  // pixel votes: keeps 95 % (5 degrees of freedom) [t-scale]
constexpr int kMinObservations = 2;   // pixel votes: frames a point needs; fewer where fewer were
                                      // given
constexpr double kMaxRelativeSigma = 0.15;  // combined: predicted sigma over inverse depth [-]
constexpr double kMaxDisagreement = 0.25;   // combined: of log inverse depth with neighbours [-]
constexpr float kNeighbourRadius = 60;      // combined: for an image diagonal of 800 px [px]
constexpr double kMinTWeight = 0.5;         // combined: mean over the pixels [-]

/// Every pixel of every patch that takes part in a frame.
std::vector<float> pixelsOf(const FrameResiduals& frame) {
  std::vector<float> pixels;
  pixels.reserve(frame.values.size());
  for (std::size_t i = 0; i < frame.valid.size(); ++i) {
    if (frame.valid[i] != 0) pixels.insert(pixels.end(), frame.of(i), frame.of(i) + kPatternSize);
  }
  return pixels;
}

/// Scale of every frame's residuals [grey levels].
std::vector<double> scalesOf(const std::vector<FrameResiduals>& residuals) {
  std::vector<double> scales(residuals.size());
  forEachRange(scales.size(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t f = begin; f < end; ++f) {
      scales[f] = fitTDistribution(pixelsOf(residuals[f]), kPrefilter).scale;
    }
  });
  return scales;
}

/// Flags of the patches that are to be removed.
using Verdicts = std::vector<char>;

Verdicts votePixels(const std::vector<FrameResiduals>& residuals, OutlierReport& report) {
  const std::vector<double> scales = scalesOf(residuals);
  std::vector<int> remaining(residuals.front().valid.size(), 0);
  for (std::size_t f = 0; f < residuals.size(); ++f) {
    const FrameResiduals& frame = residuals[f];
    const auto cut = static_cast<float>(kTQuantile * scales[f]);
    for (std::size_t i = 0; i < remaining.size(); ++i) {
      if (frame.valid[i] == 0) continue;
      const auto out = std::count_if(
          frame.of(i), frame.of(i) + kPatternSize, [cut](float r) { return std::abs(r) >= cut; });
      remaining[i] += 2 * out > kPatternSize ? 0 : 1;
    }
  }
  report.t_scale = medianOf(scales);
  const int needed = std::min(kMinObservations, static_cast<int>(residuals.size()));
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
};

/// Lengths of the reference's gradients, kPatternSize a patch [grey levels / px].
std::vector<float> gradientLengths(const PhotometricProblem& problem,
                                   const PyramidLevel& reference) {
  std::vector<float> lengths(problem.patches.size() * kPatternSize);
  forEachRange(problem.patches.size(), kPatchGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const PatchGradients g = hostGradients(problem.patches[i], reference);
      for (std::size_t j = 0; j < kPattern.size(); ++j) {
        lengths[i * kPattern.size() + j] = std::sqrt(g.x[j] * g.x[j] + g.y[j] * g.y[j]);
      }
    }
  });
  return lengths;
}

/// Residuals at pixels with some gradients.
struct GradientClass {
  float least;     ///< [grey levels / px]
  float greatest;  ///< not included
  double gradient = 0;
  double sigma = 0;  ///< of the residuals, robust [grey levels]
  bool empty = true;

  void collect(const std::vector<FrameResiduals>& residuals, const std::vector<float>& lengths) {
    std::vector<float> magnitudes;
    magnitudes.reserve(residuals.size() * lengths.size());
    double sum = 0;
    for (const FrameResiduals& frame : residuals) {
      for (std::size_t k = 0; k < lengths.size(); ++k) {
        const bool inside = lengths[k] >= least && lengths[k] < greatest;
        if (!inside || frame.valid[k / kPattern.size()] == 0) continue;
        magnitudes.push_back(std::abs(frame.values[k]));
        sum += static_cast<double>(lengths[k]);
      }
    }
    empty = magnitudes.empty();
    gradient = sum / std::max<double>(1, static_cast<double>(magnitudes.size()));
    sigma = kMadToSigma * static_cast<double>(medianInPlace(magnitudes));
  }
};

/// Fits the noise model to the median residuals at weak and at strong gradients.
/// @source docs/experiments.md, "Outlier filter"
NoiseModel fitNoise(const std::vector<FrameResiduals>& residuals,
                    const std::vector<float>& lengths) {
  constexpr float kWeak = 20;         // [grey levels / px]
  constexpr float kStrong = 40;       // [grey levels / px]
  constexpr double kMinVariance = 1;  // of grey values [grey levels^2]
  GradientClass weak{0, kWeak};
  GradientClass strong{kStrong, std::numeric_limits<float>::infinity()};
  runBoth([&] { weak.collect(residuals, lengths); }, [&] { strong.collect(residuals, lengths); });
  NoiseModel noise;
  const double weak_square = weak.gradient * weak.gradient;
  const double span = strong.gradient * strong.gradient - weak_square;
  if (span > 0 && !weak.empty) {
    noise.position_variance =
        std::max(0.0, (strong.sigma * strong.sigma - weak.sigma * weak.sigma) / span);
  }
  noise.grey_variance =
      std::max(kMinVariance, weak.sigma * weak.sigma - noise.position_variance * weak_square);
  return noise;
}

/// Divides residuals by the noise expected at their gradients.
void whiten(const std::vector<float>& lengths, std::vector<FrameResiduals>& residuals) {
  const NoiseModel noise = fitNoise(residuals, lengths);
  const auto grey = static_cast<float>(noise.grey_variance);
  const auto position = static_cast<float>(noise.position_variance);
  forEachRange(residuals.size(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t f = begin; f < end; ++f) {
      std::vector<float>& values = residuals[f].values;
      for (std::size_t k = 0; k < values.size(); ++k) {
        values[k] /= std::sqrt(grey + position * lengths[k] * lengths[k]);
      }
    }
  });
}

/// Mean t-weight of each patch over all its pixels and frames; 0 for a patch that takes part
/// nowhere.
/// @param residuals whitened
std::vector<float> meanWeights(const std::vector<FrameResiduals>& residuals,
                               const std::vector<double>& scales) {
  std::vector<float> means(residuals.front().valid.size(), 0);
  forEachRange(means.size(), kPatchGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      float sum = 0;
      float count = 0;
      for (std::size_t f = 0; f < residuals.size(); ++f) {
        if (residuals[f].valid[i] == 0 || !(scales[f] > 0)) continue;
        sum += sumOfTWeights(residuals[f].of(i), kPatternSize, static_cast<float>(scales[f]));
        count += kPatternSize;
      }
      means[i] = sum / std::max(count, 1.0F);
    }
  });
  return means;
}

/// Combines predicted sigma, neighbours and residuals: on weak texture residuals do not show a
/// wrong depth, at occlusions they do.
Verdicts combine(const PhotometricProblem& problem,
                 const PhotometricState& state,
                 const std::vector<float>& weights,
                 const PhotometricMarginals& marginals) {
  std::vector<Eigen::Vector2f> pixels;
  pixels.reserve(problem.patches.size());
  for (const HostPatch& patch : problem.patches) pixels.push_back(patch.pixel);
  const std::vector<double> disagreement = neighbourDisagreement(
      pixels,
      state.inverse_depth,
      kNeighbourRadius *
          static_cast<float>(imageScale(problem.camera.width, problem.camera.height)));
  const Eigen::VectorXd formal =
      marginals.usable() ? marginals.formalVariances() : Eigen::VectorXd();
  Verdicts verdicts(problem.patches.size(), 0);
  for (std::size_t i = 0; i < verdicts.size(); ++i) {
    const double rho = state.inverse_depth[i];
    const double limit = kMaxRelativeSigma * rho;
    const auto at = static_cast<Eigen::Index>(i);
    const bool sharp = !marginals.usable() || (formal[at] > 0 && formal[at] <= limit * limit);
    const bool good = rho > 0 && sharp && disagreement[i] <= kMaxDisagreement &&
                      static_cast<double>(weights[i]) >= kMinTWeight;
    verdicts[i] = good ? 0 : 1;
  }
  return verdicts;
}

/// Drops corners, with their observations, and semi-dense points.
void removeFrom(InitialMap& map,
                PhotometricProblem& problem,
                const Verdicts& verdicts,
                OutlierReport& report) {
  const std::size_t corners = map.corners.size();
  std::vector<char> gone(corners + map.points.size(), 0);
  std::vector<std::size_t> kept_patches;
  for (std::size_t i = 0; i < verdicts.size(); ++i) {
    gone[problem.source[i]] = verdicts[i];
    if (verdicts[i] == 0) kept_patches.push_back(i);
  }
  std::vector<std::size_t> new_source(gone.size());
  std::size_t kept = 0;
  for (std::size_t i = 0; i < gone.size(); ++i) {
    new_source[i] = kept;
    kept += gone[i] == 0 ? 1 : 0;
  }
  problem = subProblem(problem, kept_patches);
  for (std::size_t& source : problem.source) source = new_source[source];
  const auto first_point = gone.begin() + static_cast<std::ptrdiff_t>(corners);
  const std::size_t points = map.points.size();
  removeCorners(map, {gone.begin(), first_point});
  eraseMarked({first_point, gone.end()}, map.points);
  report.examined = static_cast<int>(gone.size());
  report.removed_corners = static_cast<int>(corners - map.corners.size());
  report.removed_points = static_cast<int>(points - map.points.size());
}

}  // namespace

OutlierReport removeOutliers(InitialMap& map, PhotometricProblem& problem, OutlierRule rule) {
  OutlierReport report;
  if (rule == OutlierRule::kNone || problem.frames.empty()) return report;
  const PhotometricState state = makeState(problem, map);
  findVisible(problem, state);
  std::vector<FrameResiduals> residuals = residualsOf(problem, state);
  if (rule == OutlierRule::kPixelVotes) {
    removeFrom(map, problem, votePixels(residuals, report), report);
    return report;
  }
  whiten(gradientLengths(problem, map.frames.front().frame->level(0)), residuals);
  const std::vector<double> scales = scalesOf(residuals);
  report.t_scale = medianOf(scales);
  const Verdicts verdicts =
      combine(problem, state, meanWeights(residuals, scales), PhotometricMarginals(problem, state));
  removeFrom(map, problem, verdicts, report);
  return report;
}

}  // namespace dsorb::init_orb
