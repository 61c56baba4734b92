// SPDX-License-Identifier: BSD-3-Clause
#include "published/photometric.h"

#include "base/median.h"
#include "base/parallel.h"
#include "estimate/robust_loss.h"
#include "estimate/warp.h"
#include "published/bundle_adjustment.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

namespace dsorb::published {
namespace {

constexpr double kMinGreySum = 8;   // of a patch; psi of a darker one means nothing [grey levels]
constexpr int kMaxSolveSteps = 10;  // of one solve
constexpr std::size_t kMinPatches = 8;   // fewer do not determine a frame
constexpr double kMinInsideShare = 0.5;  // of the residuals; fewer inside the images: failed
/// Median above which a coarser level comes first: level 0 is far from its basin [grey levels].
constexpr double kCoarseResidual = 20;

constexpr double kPrefilter = 3;       // residuals beyond do not enter the fit [1.4826 MAD]
constexpr double kDegrees = 5;         // nu; Kerl, Sturm, Cremers, ICRA 2013
constexpr double kConvergence = 1e-3;  // relative change of the squared scale
constexpr int kMaxFits = 50;           // measured: 8 to 12 are needed
constexpr double kMinScale = 0.29;     // error of rounding, 1 / sqrt(12) [grey levels]
constexpr double kQuantile = 2.571;    // of the distribution: 97.5 %; it keeps 95 % [t-scale]
constexpr std::size_t kMinViews = 2;   // frames a point needs; fewer where fewer were given

/// One patch in one frame as Ceres sees it: 8 residuals whose squares are the Huber energies of the
/// pixels. Parameters: pose, inverse depth.
class PhotometricCost final : public ceres::SizedCostFunction<kPatternSize, 7, 1> {
 public:
  PhotometricCost(const PhotometricProblem& problem, std::size_t patch, std::size_t frame)
      : problem_(problem), patch_(patch), frame_(frame) {}

  bool Evaluate(double const* const* parameters,
                double* residuals,
                double** jacobians) const override {
    const PatchResidual patch =
        evaluatePatch(problem_, patch_, frame_, fromBlock(parameters[0]), parameters[1][0]);
    constexpr auto kThreshold = static_cast<double>(kHuberThreshold);
    PatchVector factor;  // derivative of each residual by the difference of grey levels
    for (int j = 0; j < kPatternSize; ++j) {
      const double r = patch.value[j];
      const bool valid = std::isfinite(r);
      const bool linear = std::abs(r) > kThreshold;
      // The root of Huber's loss, which Ceres squares; robust_loss.h has the loss and its weight.
      const double root =
          linear ? std::sqrt(2 * kThreshold * std::abs(r) - kThreshold * kThreshold) : std::abs(r);
      residuals[j] = valid ? std::copysign(root, r) : kThreshold;
      factor[j] = !valid ? 0 : linear ? kThreshold / root : 1;
    }
    if (jacobians != nullptr && jacobians[0] != nullptr) {
      Eigen::Map<Eigen::Matrix<double, kPatternSize, 7, Eigen::RowMajor>>(jacobians[0])
          << factor.asDiagonal() * patch.J_pose,
          PatchVector::Zero();
    }
    if (jacobians != nullptr && jacobians[1] != nullptr) {
      Eigen::Map<PatchVector>(jacobians[1], kPatternSize) =
          factor.cwiseProduct(patch.J_inverse_depth);
    }
    return true;
  }

 private:
  const PhotometricProblem& problem_;
  std::size_t patch_;
  std::size_t frame_;
};

/// Calls visit(frame, patch, residual) for all patches inside the images.
template <typename Visit>
void forInside(const PhotometricProblem& problem, const Map& map, Visit&& visit) {
  for (std::size_t k = 1; k < map.frames.size(); ++k) {
    const std::vector<PatchResidual> residuals = residualsOf(problem, map, k);
    for (std::size_t i = 0; i < residuals.size(); ++i) {
      if (residuals[i].inside) visit(k, i, residuals[i]);
    }
  }
}

/// Moves poses and inverse depths to the minimum over the patches inside the images.
std::optional<Solved> solve(const PhotometricProblem& problem, Map& map) {
  if (problem.patches.size() < kMinPatches) return std::nullopt;
  std::vector<double> inverse_depths;
  for (const std::size_t i : problem.points) inverse_depths.push_back(map.points[i].inverse_depth);
  CeresAdjustment adjustment(map.poses(), inverse_depths);
  forInside(problem, map, [&](std::size_t k, std::size_t i, const PatchResidual& /*residual*/) {
    adjustment.add(new PhotometricCost(problem, i, k), nullptr, k - 1, i);
  });
  std::optional<Solved> solved = adjustment.solve(kMaxSolveSteps);
  if (solved) write(*solved, problem.points, map);
  return solved;
}

}  // namespace

PhotometricProblem::PhotometricProblem(const Map& map, const PinholeCamera& full, int level)
    : camera(full.atLevel(level)) {
  for (const PosedFrame& frame : map.frames) images.push_back(&frame.frame->level(level));
  const float scale = 1.0F / static_cast<float>(1 << level);
  for (std::size_t i = 0; i < map.points.size(); ++i) {
    const Eigen::Vector2f at = ((map.points[i].pixel.array() + 0.5F) * scale - 0.5F).matrix();
    const auto patch = readHostPatch<interpolate<float>>(*images.front(), at);
    if (!patch) continue;
    patches.push_back(*patch);
    points.push_back(i);
  }
}

PatchResidual evaluatePatch(const PhotometricProblem& problem,
                            std::size_t patch,
                            std::size_t frame,
                            const SE3& T_cam_ref,
                            double inverse_depth) {
  const HostPatch& host = problem.patches[patch];
  const PyramidLevel& image = *problem.images[frame];
  const auto warp = makeWarp<double>(problem.camera, T_cam_ref);
  const Eigen::Vector3d centre = problem.camera.unproject(host.pixel.cast<double>());
  const auto area = sampleArea<double>(image.width(), image.height());
  PatchResidual out;
  out.inside = true;
  PatchVector grey;
  PatchVector expected;
  for (int j = 0; j < kPatternSize; ++j) {
    const PatternOffset& offset = kPattern[static_cast<std::size_t>(j)];
    const double ray_x = centre.x() + offset.x / warp.fx;
    const double ray_y = centre.y() + offset.y / warp.fy;
    const WarpedPoint<double> point = warpPoint(warp, ray_x, ray_y, inverse_depth);
    const SamplePosition<double> at = clampToArea(area, point);
    const Sample<double> sample = interpolate(image, at.x, at.y);
    const bool inside = point.front && at.inside;
    const RayGradient<double> gradient =
        rayGradient(warp, point, inside ? sample.dx : 0, inside ? sample.dy : 0);
    Vector6d J_pose;
    poseJacobian(point, gradient, inverse_depth * point.inverse_z, J_pose.data());
    out.J_inverse_depth[j] = depthJacobian(warp, point, gradient);
    out.J_pose.row(j) = J_pose;
    out.inside = out.inside && inside && std::isfinite(sample.intensity);
    grey[j] = sample.intensity;
    expected[j] = static_cast<double>(host.grey[static_cast<std::size_t>(j)]);
  }
  out.psi = grey.sum() / std::max(expected.sum(), kMinGreySum);
  out.value = grey - out.psi * expected;
  return out;
}

std::vector<PatchResidual> residualsOf(const PhotometricProblem& problem,
                                       const Map& map,
                                       std::size_t frame) {
  std::vector<PatchResidual> residuals(problem.patches.size());
  forEachRange(residuals.size(), kTaskGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const double inverse_depth = map.points[problem.points[i]].inverse_depth;
      residuals[i] = evaluatePatch(problem, i, frame, map.pose(frame), inverse_depth);
    }
  });
  return residuals;
}

bool performPhotometricBA(Map& map, const PinholeCamera& camera) {
  const PhotometricProblem problem(map, camera, 0);
  std::vector<double> magnitudes;  // of one pixel a patch in turn
  forInside(problem, map, [&](std::size_t /*k*/, std::size_t i, const PatchResidual& residual) {
    magnitudes.push_back(std::abs(residual.value[static_cast<Eigen::Index>(i % kPatternSize)]));
  });
  Map adjusted = map;
  if (medianOf(std::move(magnitudes)) > kCoarseResidual &&
      map.frames.front().frame->pyramid().levels() > 1) {
    solve({map, camera, 1}, adjusted);  // without a result the depths stay as they are
  }
  const std::optional<Solved> solved = solve(problem, adjusted);
  if (!solved || !(solved->cost <= solved->first_cost)) return false;
  std::size_t inside = 0;
  forInside(problem, adjusted, [&](std::size_t, std::size_t, const PatchResidual&) { ++inside; });
  const std::size_t all = (map.frames.size() - 1) * problem.patches.size();
  if (static_cast<double>(inside) < kMinInsideShare * static_cast<double>(all) ||
      !normalizeScale(adjusted, adjusted.points.size())) {
    return false;
  }
  map = std::move(adjusted);
  return true;
}

double fitTDistribution(const std::vector<double>& residuals) {
  const double median = medianOf(residuals);
  std::vector<double> deviations;
  double deviation_square = 0;
  for (const double residual : residuals) {
    deviations.push_back(std::abs(residual - median));
    deviation_square += std::pow(deviations.back(), 2) / static_cast<double>(residuals.size());
  }
  double spread = kMadToSigma * medianOf(deviations);
  // More than half of the residuals are the same: a still overlay, strongly quantized images.
  const bool degenerate = !residuals.empty() && !(spread > 0);
  if (degenerate) spread = std::max(std::sqrt(deviation_square), kMinScale);
  std::vector<double> squares;
  for (std::size_t i = 0; i < residuals.size(); ++i) {
    if (deviations[i] < kPrefilter * spread) squares.push_back(residuals[i] * residuals[i]);
  }
  double variance = spread * spread;
  for (int i = 0; i < kMaxFits && !squares.empty() && variance > 0; ++i) {
    double sum = 0;
    for (const double square : squares) sum += square / (kDegrees + square / variance);
    const double next = (kDegrees + 1) * sum / static_cast<double>(squares.size());
    const bool converged = std::abs(next - variance) <= kConvergence * variance;
    variance = next;
    if (converged) break;
  }
  return degenerate ? std::max(std::sqrt(variance), kMinScale) : std::sqrt(variance);
}

void removeOutliers(Map& map, const PinholeCamera& camera) {
  const PhotometricProblem problem(map, camera, 0);
  std::vector<std::vector<double>> residuals(map.frames.size());
  forInside(problem, map, [&](std::size_t k, std::size_t /*i*/, const PatchResidual& patch) {
    residuals[k].insert(residuals[k].end(), patch.value.begin(), patch.value.end());
  });
  std::vector<double> scales;
  for (std::size_t k = 1; k < residuals.size(); ++k)
    scales.push_back(fitTDistribution(residuals[k]));
  std::vector<std::size_t> views(problem.patches.size(), 0);
  forInside(problem, map, [&](std::size_t k, std::size_t i, const PatchResidual& patch) {
    const auto discarded = (patch.value.array().abs() >= kQuantile * scales[k - 1]).count();
    views[i] += 2 * discarded <= kPatternSize ? 1 : 0;
  });
  std::vector<char> removed(map.points.size(), 0);
  for (std::size_t i = 0; i < views.size(); ++i) {
    removed[problem.points[i]] = views[i] < std::min(kMinViews, scales.size()) ? 1 : 0;
  }
  removePoints(map, removed);
}

}  // namespace dsorb::published
