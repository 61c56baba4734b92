// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/photometric/photometric_adjustment.h"

#include "base/median.h"
#include "init/orb/photometric/photometric_covariance.h"
#include "init/orb/photometric/photometric_solvers.h"
#include "init/orb/photometric/pose_combination.h"

#include <algorithm>
#include <cmath>
#include <numeric>
#include <utility>

namespace dsorb::init_orb {
namespace {

constexpr double kMinInsideShare = 0.5;  // of the residuals; fewer inside the images: failed
constexpr std::size_t kMinPatches = 8;   // fewer do not determine a frame
/// Median above which a coarser level comes first: level 0 is far from its basin [grey levels].
/// @source docs/experiments.md, "Photometric adjustment"
constexpr double kCoarseResidual = 20;
/// Of the points that have no part in the joint solution, poses fixed.
/// @source the same
constexpr int kDepthIterations = 3;
/// On the clustered covariance of the images' own poses, against the corners'.
/// @source docs/experiments.md, "Photometric adjustment"
constexpr double kCombinedVarianceFactor = 36;

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

/// State of some patches with all frames.
PhotometricState partOf(const PhotometricState& state, const std::vector<std::size_t>& patches) {
  PhotometricState part{state.T_cam_ref, state.affine, {}};
  for (const std::size_t i : patches) part.inverse_depth.push_back(state.inverse_depth[i]);
  return part;
}

double sum(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0);
}

/// @param factor on lengths
void changeUnit(double factor, PhotometricState& state) {
  for (SE3& pose : state.T_cam_ref) pose.setTranslation(factor * pose.translation());
  for (double& inverse_depth : state.inverse_depth) inverse_depth /= factor;
}

/// Joint solution over some patches, written into the state of all.
std::optional<PhotometricSolve> solveJoint(const PhotometricProblem& problem,
                                           const std::vector<std::size_t>& patches,
                                           const PhotometricOptions& options,
                                           PhotometricState& state) {
  PhotometricState part = partOf(state, patches);
  const std::optional<PhotometricSolve> solve =
      solvePhotometricWithSchur(subProblem(problem, patches), options, part);
  if (!solve) return std::nullopt;
  state.T_cam_ref = part.T_cam_ref;
  state.affine = part.affine;
  for (std::size_t i = 0; i < patches.size(); ++i) {
    state.inverse_depth[patches[i]] = part.inverse_depth[i];
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

/// Poses that the images alone ask for.
struct PosesOfImages {
  std::vector<SE3> T_cam_ref;  ///< by frame of the problem
  Eigen::MatrixXd covariance;  ///< of left increments, 6 rows each
};

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
  [[nodiscard]] std::optional<PosesOfImages> posesOfImages(const PhotometricState& state);
  bool combine(PhotometricState& state);
  void exchangePoses();
  void alignOtherFrames();

  InitialMap& map_;
  const PinholeCamera& camera_;
  const PhotometricOptions& options_;
  PhotometricProblem& problem_;
  PhotometricReport report_;
  std::vector<SE3> combined_;  // by joint frame; empty: they stay
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
  const PhotometricSolve solve = refinePhotometricDepths(problem_, options_.max_iterations, state);
  report_.iterations = solve.iterations;
  report_.first_cost = solve.first_cost;
  report_.cost = solve.cost;
  return solve.cost <= solve.first_cost;
}

/// The images' own poses of the problem's frames with their covariance, in the map's unit.
std::optional<PosesOfImages> PhotometricAdjustment::posesOfImages(const PhotometricState& state) {
  const auto patches = jointPatches(problem_, map_, options_.joint_points);
  const PhotometricProblem part = subProblem(problem_, patches);
  PhotometricState solution = partOf(state, patches);
  const double before = sum(solution.inverse_depth);
  const auto solve = solvePhotometricWithSchur(part, options_, solution);
  if (!solve || !isFinite(solution)) return std::nullopt;
  if (part.known.empty()) changeUnit(sum(solution.inverse_depth) / before, solution);
  const PhotometricMarginals marginals(part, solution);
  if (!marginals.usable()) return std::nullopt;
  return PosesOfImages{solution.T_cam_ref,
                       kCombinedVarianceFactor * marginals.clusteredPoseCovariance()};
}

/// Moves the poses towards those of the images, as far as these know better.
/// @return false where they stay
bool PhotometricAdjustment::combine(PhotometricState& state) {
  const std::vector<Eigen::Index> rows = jointRows(map_, problem_);
  if (rows.empty()) return false;
  const auto images = posesOfImages(state);
  if (!images) return false;
  CombinedPoses combined = combinePoses(map_, problem_, images->T_cam_ref, images->covariance);
  report_.pose_distance = combined.distance;
  if (!(combined.distance <= kMaxPoseDistance)) return false;
  for (std::size_t f = 0; f < state.T_cam_ref.size(); ++f) {
    state.T_cam_ref[f] = combined.T_cam_ref[static_cast<std::size_t>(rows[6 * f] / 6)];
  }
  combined_ = std::move(combined.T_cam_ref);
  return true;
}

bool PhotometricAdjustment::solveFine(PhotometricState& state) {
  if (options_.poses != PhotometricPoses::kFree) {
    const bool moved = options_.poses == PhotometricPoses::kCombined && combine(state);
    report_.poses_moved = moved;
    if (!moved) state.T_cam_ref = makeState(problem_, map_).T_cam_ref;
    return refineDepths(state);
  }
  const auto joint = jointPatches(problem_, map_, options_.joint_points);
  const std::optional<PhotometricSolve> solve = solveJoint(problem_, joint, options_, state);
  if (!solve || !isFinite(state)) return false;
  report_.iterations = solve->iterations;
  report_.first_cost = solve->first_cost;
  report_.cost = solve->cost;
  report_.poses_moved = true;
  if (joint.size() < problem_.patches.size()) {
    refinePhotometricDepths(problem_, kDepthIterations, state);
  }
  return solve->cost <= solve->first_cost;
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

/// Between the map and the combined ones.
void PhotometricAdjustment::exchangePoses() {
  for (std::size_t i = 0; i < combined_.size(); ++i) {
    std::swap(*map_.frames[map_.joint_frames[i]].T_cam_ref, combined_[i]);
  }
}

PhotometricReport PhotometricAdjustment::run() {
  report_.frames = static_cast<int>(problem_.frames.size());
  report_.patches = static_cast<int>(problem_.patches.size());
  if (problem_.frames.empty() || problem_.patches.size() < kMinPatches) return report_;
  const PhotometricState before = makeState(problem_, map_);
  PhotometricState state = before;
  placePatches(problem_, state);
  findVisible(problem_, state);
  report_.median_residual = medianResidual(problem_, state);
  const bool far = report_.median_residual > kCoarseResidual;
  if (far && map_.frames.front().frame->pyramid().levels() > 1) solveCoarse(state);
  if (!solveFine(state) || !isFinite(state)) return report_;
  report_.inside_share = findVisible(problem_, state);
  if (report_.inside_share < kMinInsideShare) return report_;
  writeState(problem_, state, map_);
  exchangePoses();
  report_.usable = normalizeMapScale(map_);
  takeUnit(problem_, map_);
  if (!report_.usable) {
    exchangePoses();
    writeState(problem_, before, map_);
  } else if (options_.poses == PhotometricPoses::kFree) {
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

}  // namespace dsorb::init_orb
