// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/photometric/photometric_adjustment.h"

#include "base/median.h"
#include "init/orb/photometric/photometric_solvers.h"

#include <Eigen/Eigenvalues>

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

namespace dsorb::init_orb {
namespace {

constexpr double kMinInsideShare = 0.5;  // of the residuals; fewer inside the images: failed
constexpr std::size_t kMinPatches = 8;   // fewer do not determine a frame

/// Median of the absolute residuals in all frames, of one pixel a patch in turn [grey levels].
double medianResidual(const PhotometricProblem& problem, const PhotometricState& state) {
  std::vector<double> magnitudes;
  magnitudes.reserve(problem.seen.size());
  for (const FrameResiduals& frame : residualsOf(problem, state)) {
    for (std::size_t i = 0; i < frame.valid.size(); ++i) {
      if (frame.valid[i] == 0) continue;
      magnitudes.push_back(std::abs(static_cast<double>(frame.of(i)[i % kPatternSize])));
    }
  }
  return medianOf(std::move(magnitudes));
}

/// All corners and the semi-dense points with the smallest relative variance.
std::vector<std::size_t> jointPatches(const PhotometricProblem& problem,
                                      const InitialMap& map,
                                      int points) {
  std::vector<std::size_t> all(problem.patches.size());
  std::iota(all.begin(), all.end(), std::size_t{0});
  const auto wanted = static_cast<std::size_t>(points);
  const std::size_t corners = map.corners.size();
  const auto first_point = static_cast<std::size_t>(
      std::lower_bound(problem.source.begin(), problem.source.end(), corners) -
      problem.source.begin());
  if (points == 0 || all.size() - first_point <= wanted) return all;
  const auto relative_variance = [&](std::size_t patch) {
    const SemiDensePoint& point = map.points[problem.source[patch] - corners];
    return point.variance / (point.inverse_depth * point.inverse_depth);
  };
  const auto begin = all.begin() + static_cast<std::ptrdiff_t>(first_point);
  std::nth_element(begin,
                   begin + static_cast<std::ptrdiff_t>(wanted),
                   all.end(),
                   [&](std::size_t a, std::size_t b) {
                     const float va = relative_variance(a);
                     const float vb = relative_variance(b);
                     return va < vb || (va == vb && a < b);
                   });
  all.resize(first_point + wanted);
  std::sort(all.begin(), all.end());
  return all;
}

/// Joint solution over some patches, written into the state of all.
std::optional<PhotometricSolve> solveJoint(const PhotometricProblem& problem,
                                           const std::vector<std::size_t>& patches,
                                           const PhotometricOptions& options,
                                           PhotometricState& state) {
  const PhotometricProblem part = subProblem(problem, patches);
  PhotometricState part_state = state;
  part_state.inverse_depth.clear();
  for (const std::size_t i : patches) part_state.inverse_depth.push_back(state.inverse_depth[i]);
  const std::optional<PhotometricSolve> solve =
      options.solver == AdjustmentSolver::kCeres
          ? solvePhotometricWithCeres(part, options, part_state)
          : solvePhotometricWithSchur(part, options, part_state);
  if (!solve) return std::nullopt;
  state.T_cam_ref = part_state.T_cam_ref;
  state.affine = part_state.affine;
  for (std::size_t i = 0; i < patches.size(); ++i) {
    state.inverse_depth[patches[i]] = part_state.inverse_depth[i];
  }
  return solve;
}

bool isFinite(const PhotometricState& state) {
  return std::all_of(state.T_cam_ref.begin(),
                     state.T_cam_ref.end(),
                     [](const SE3& pose) { return pose.matrix().allFinite(); }) &&
         std::all_of(state.inverse_depth.begin(), state.inverse_depth.end(), [](double value) {
           return std::isfinite(value);
         });
}

/// Angle between two directions of translation over the sigma that the covariance gives the first.
double directionMove(const SE3& before, const SE3& after, const Matrix6d& covariance) {
  const Eigen::Vector3d direction = before.translation().normalized();
  const double angle =
      std::atan2(direction.cross(after.translation()).norm(), direction.dot(after.translation()));
  const Eigen::Matrix3d across = Eigen::Matrix3d::Identity() - direction * direction.transpose();
  const Eigen::Matrix3d spread = across * covariance.topLeftCorner<3, 3>() * across;
  const double variance = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(spread).eigenvalues()[2];
  return angle * before.translation().norm() / std::sqrt(std::max(variance, 1e-300));
}

/// One adjustment of one map, step by step.
class PhotometricAdjustment {
 public:
  PhotometricAdjustment(InitialMap& map,
                        PhotometricProblem& problem,
                        const PinholeCamera& camera,
                        const PhotometricOptions& options)
      : map_(map), camera_(camera), options_(options), problem_(problem) {}

  PhotometricReport run();

 private:
  void solveCoarse(PhotometricState& state);
  bool solveFine(PhotometricState& state);
  bool refineDepths(PhotometricState& state);
  [[nodiscard]] bool posesAreUnknown() const;
  [[nodiscard]] bool mayMove(const PhotometricState& state);
  void alignOtherFrames();

  InitialMap& map_;
  const PinholeCamera& camera_;
  const PhotometricOptions& options_;
  PhotometricProblem& problem_;
  PhotometricReport report_;
};

/// The joint problem at level 1, when the images are too far apart for level 0.
void PhotometricAdjustment::solveCoarse(PhotometricState& state) {
  std::vector<std::size_t> frames;
  for (const PhotometricFrame& frame : problem_.frames) frames.push_back(frame.index);
  PhotometricProblem coarse = makeProblem(map_, camera_, options_, frames, 1);
  PhotometricState coarse_state = makeState(coarse, map_);
  findVisible(coarse, coarse_state);
  if (coarse.patches.size() < kMinPatches) return;
  const std::optional<PhotometricSolve> solve =
      solveJoint(coarse, jointPatches(coarse, map_, options_.joint_points), options_, coarse_state);
  if (!solve || !isFinite(coarse_state)) return;
  InitialMap moved = map_;
  writeState(coarse, coarse_state, moved);
  state = makeState(problem_, moved);
  findVisible(problem_, state);
  report_.coarse_level = true;
}

bool PhotometricAdjustment::refineDepths(PhotometricState& state) {
  PhotometricOptions options = options_;
  options.depth_iterations = options_.max_iterations;
  const PhotometricSolve solve = refinePhotometricDepths(problem_, options, state);
  report_.iterations = solve.iterations;
  report_.first_cost = solve.first_cost;
  report_.cost = solve.cost;
  return solve.cost <= solve.first_cost;
}

bool PhotometricAdjustment::solveFine(PhotometricState& state) {
  if (!posesAreUnknown()) return refineDepths(state);
  const PhotometricState before = state;
  const auto joint = jointPatches(problem_, map_, options_.joint_points);
  const std::optional<PhotometricSolve> solve = solveJoint(problem_, joint, options_, state);
  if (!solve || !isFinite(state)) return false;
  report_.iterations = solve->iterations;
  report_.first_cost = solve->first_cost;
  report_.cost = solve->cost;
  if (!mayMove(state)) {
    state = before;
    return refineDepths(state);
  }
  report_.poses_moved = true;
  if (joint.size() < problem_.patches.size()) refinePhotometricDepths(problem_, options_, state);
  return solve->cost <= solve->first_cost;
}

/// Whether the images can say more about the poses than the corners did.
/// @source docs/experiments.md, "Photometric adjustment"
bool PhotometricAdjustment::posesAreUnknown() const {
  return options_.poses == PhotometricPoses::kFree ||
         static_cast<int>(map_.corners.size()) < options_.enough_corners;
}

bool PhotometricAdjustment::mayMove(const PhotometricState& state) {
  const std::size_t target = problem_.frames.back().index;
  if (!map_.frames[target].covariance) return true;
  report_.direction_sigmas = directionMove(
      *map_.frames[target].T_cam_ref, state.T_cam_ref.back(), *map_.frames[target].covariance);
  return options_.poses == PhotometricPoses::kFree || report_.direction_sigmas <= kMaxPoseMove;
}

/// Posed frames that had no part follow the adjusted depths.
void PhotometricAdjustment::alignOtherFrames() {
  std::vector<std::size_t> others;
  for (std::size_t k = 1; k < map_.frames.size(); ++k) {
    const bool part = std::any_of(problem_.frames.begin(),
                                  problem_.frames.end(),
                                  [k](const PhotometricFrame& frame) { return frame.index == k; });
    if (map_.frames[k].T_cam_ref && !part) others.push_back(k);
  }
  if (others.empty()) return;
  PhotometricProblem problem = makeProblem(map_, camera_, options_, others, 0);
  PhotometricState state = makeState(problem, map_);
  findVisible(problem, state);
  const auto patches = jointPatches(problem, map_, options_.joint_points);
  problem = subProblem(problem, patches);
  state = makeState(problem, map_);
  if (alignPhotometricPoses(problem, options_, state) && isFinite(state)) {
    writeState(problem, state, map_);
  }
}

PhotometricReport PhotometricAdjustment::run() {
  report_.frames = static_cast<int>(problem_.frames.size());
  report_.patches = static_cast<int>(problem_.patches.size());
  if (problem_.frames.empty() || problem_.patches.size() < kMinPatches) return report_;
  placeKnownDepths(problem_, map_);
  const PhotometricState before = makeState(problem_, map_);
  PhotometricState state = before;
  placePatches(problem_, state);
  findVisible(problem_, state);
  report_.median_residual = medianResidual(problem_, state);
  const bool far = report_.median_residual > options_.coarse_residual;
  if (far && map_.frames.front().frame->pyramid().levels() > 1) solveCoarse(state);
  if (!solveFine(state) || !isFinite(state)) return report_;
  report_.inside_share = findVisible(problem_, state);
  if (report_.inside_share < kMinInsideShare) return report_;
  writeState(problem_, state, map_);
  report_.usable = normalizeMapScale(map_);
  if (!report_.usable) {
    writeState(problem_, before, map_);
  } else if (report_.poses_moved) {
    alignOtherFrames();
  }
  return report_;
}

}  // namespace

PhotometricReport adjustPhotometry(InitialMap& map,
                                   PhotometricProblem& problem,
                                   const PinholeCamera& camera,
                                   const PhotometricOptions& options) {
  return PhotometricAdjustment(map, problem, camera, options).run();
}

PhotometricReport adjustPhotometry(InitialMap& map,
                                   const PinholeCamera& camera,
                                   const PhotometricOptions& options) {
  PhotometricProblem problem = makeProblem(map, camera, options);
  return adjustPhotometry(map, problem, camera, options);
}

}  // namespace dsorb::init_orb
