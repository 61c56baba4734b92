// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/geometric_adjustment.h"

#include "camera/reprojection.h"
#include "init/orb/geometric_covariance.h"
#include "init/orb/reprojection_cost.h"

#include <ceres/loss_function.h>
#include <ceres/problem.h>
#include <ceres/solver.h>

#include <algorithm>
#include <cmath>
#include <deque>
#include <limits>
#include <memory>

namespace dsorb::init_orb {
namespace {

/// The Ceres problem over the poses and inverse depths of a map. Built once; removing a corner
/// takes its residuals out of the problem.
class Adjustment {
 public:
  Adjustment(InitialMap& map, const PinholeCamera& camera, const GeometricOptions& options);

  /// @return iterations, or nullopt when Ceres found no usable numbers
  std::optional<int> solve();
  /// Removes corners with a larger error than `limit` [px] in any frame, and corners behind a
  /// camera. @return their number
  int removeAbove(double limit);
  /// Writes poses and inverse depths back and drops removed corners with their observations.
  void writeBack();

  [[nodiscard]] int remaining() const { return remaining_; }
  [[nodiscard]] int unseen() const { return unseen_; }
  /// Root mean square of one coordinate of the reprojection errors [px].
  [[nodiscard]] double residualRms() const;

 private:
  struct Term {
    Term(const Observation& seen, const PinholeCamera& camera, const Corner& corner, double sigma)
        : observation(&seen), cost(camera, camera.unproject(corner.pixel), seen.pixel, sigma) {}
    const Observation* observation;
    ReprojectionCost cost;
  };

  /// @return reprojection error [px]; nullopt when the point is not in front of the camera
  [[nodiscard]] std::optional<double> error(const Observation& observation) const;
  void addBlocks();
  void remove(std::size_t corner);

  InitialMap& map_;
  const PinholeCamera& camera_;
  const GeometricOptions& options_;
  int remaining_ = 0;
  int unseen_ = 0;
  std::vector<PoseBlock> poses_;
  std::vector<double> inverse_depths_;
  std::vector<char> kept_;  ///< by corner
  std::deque<Term> terms_;  ///< Ceres costs cannot move
  PoseManifold manifold_;
  ceres::HuberLoss loss_;
  std::unique_ptr<ceres::Problem> problem_;
};

ceres::Problem::Options problemOptions() {
  ceres::Problem::Options options;
  options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.loss_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.manifold_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
  options.enable_fast_removal = true;
  return options;
}

Adjustment::Adjustment(InitialMap& map,
                       const PinholeCamera& camera,
                       const GeometricOptions& options)
    : map_(map),
      camera_(camera),
      options_(options),
      poses_(map.frames.size()),
      kept_(map.corners.size(), 0),
      loss_(options.huber_threshold),
      problem_(std::make_unique<ceres::Problem>(problemOptions())) {
  for (std::size_t k = 0; k < map.frames.size(); ++k) {
    if (map.T_cam_ref[k]) {
      poses_[k] = toBlock(*map.T_cam_ref[k]);
    }
  }
  inverse_depths_.reserve(map.corners.size());
  for (const Corner& corner : map.corners) {
    inverse_depths_.push_back(corner.inverse_depth);
  }
  for (const Observation& observation : map.observations) {
    const auto corner = static_cast<std::size_t>(observation.corner);
    if (!map.T_cam_ref[static_cast<std::size_t>(observation.frame)]) {
      continue;
    }
    terms_.emplace_back(observation, camera, map.corners[corner], options.sigma);
    kept_[corner] = 1;
  }
  for (const char seen : kept_) {
    remaining_ += seen != 0 ? 1 : 0;
  }
  unseen_ = static_cast<int>(kept_.size()) - remaining_;
  addBlocks();
}

void Adjustment::addBlocks() {
  for (Term& term : terms_) {
    double* pose = poses_[static_cast<std::size_t>(term.observation->frame)].data();
    double* inverse_depth = &inverse_depths_[static_cast<std::size_t>(term.observation->corner)];
    problem_->AddResidualBlock(&term.cost, &loss_, pose, inverse_depth);
  }
  for (PoseBlock& pose : poses_) {
    if (problem_->HasParameterBlock(pose.data())) {
      problem_->SetManifold(pose.data(), &manifold_);
    }
  }
}

std::optional<int> Adjustment::solve() {
  ceres::Solver::Options solver;
  solver.linear_solver_type = ceres::DENSE_SCHUR;
  solver.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (std::size_t i = 0; i < inverse_depths_.size(); ++i) {
    if (kept_[i] != 0) {
      solver.linear_solver_ordering->AddElementToGroup(&inverse_depths_[i], 0);
    }
  }
  for (PoseBlock& pose : poses_) {
    if (problem_->HasParameterBlock(pose.data())) {
      solver.linear_solver_ordering->AddElementToGroup(pose.data(), 1);
    }
  }
  solver.max_num_iterations = options_.max_iterations;
  solver.function_tolerance = options_.function_tolerance;
  solver.num_threads = 1;  // with more the sums have no fixed order
  solver.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(solver, problem_.get(), &summary);
  if (!summary.IsSolutionUsable()) {
    return std::nullopt;
  }
  return static_cast<int>(summary.iterations.size());
}

std::optional<double> Adjustment::error(const Observation& observation) const {
  const auto corner = static_cast<std::size_t>(observation.corner);
  const std::optional<HostedProjection> projection =
      projectHosted(camera_,
                    fromBlock(poses_[static_cast<std::size_t>(observation.frame)].data()),
                    camera_.unproject(map_.corners[corner].pixel),
                    inverse_depths_[corner]);
  if (!projection || !(inverse_depths_[corner] > 0)) {
    return std::nullopt;
  }
  return (projection->pixel - observation.pixel).norm();
}

int Adjustment::removeAbove(double limit) {
  const int before = remaining_;
  for (const Term& term : terms_) {
    const auto corner = static_cast<std::size_t>(term.observation->corner);
    if (kept_[corner] == 0) {
      continue;
    }
    const std::optional<double> distance = error(*term.observation);
    if (!distance || !(*distance <= limit)) {
      remove(corner);
    }
  }
  return before - remaining_;
}

void Adjustment::remove(std::size_t corner) {
  kept_[corner] = 0;
  --remaining_;
  problem_->RemoveParameterBlock(&inverse_depths_[corner]);
}

double Adjustment::residualRms() const {
  double sum = 0;
  int count = 0;
  for (const Term& term : terms_) {
    if (kept_[static_cast<std::size_t>(term.observation->corner)] != 0) {
      const double distance = error(*term.observation).value_or(0);
      sum += distance * distance;
      count += 2;
    }
  }
  return std::sqrt(sum / std::max(count, 1));
}

void Adjustment::writeBack() {
  for (std::size_t k = 1; k < poses_.size(); ++k) {
    if (problem_->HasParameterBlock(poses_[k].data())) {
      map_.T_cam_ref[k] = fromBlock(poses_[k].data());
    }
  }
  std::vector<int> new_index(kept_.size(), -1);
  std::size_t next = 0;
  for (std::size_t i = 0; i < kept_.size(); ++i) {
    if (kept_[i] != 0) {
      new_index[i] = static_cast<int>(next);
      map_.corners[next] = map_.corners[i];
      map_.corners[next++].inverse_depth = inverse_depths_[i];
    }
  }
  map_.corners.resize(next);
  terms_.clear();
  next = 0;
  for (const Observation& observation : map_.observations) {
    const int corner = new_index[static_cast<std::size_t>(observation.corner)];
    if (corner >= 0) {
      map_.observations[next] = observation;
      map_.observations[next++].corner = corner;
    }
  }
  map_.observations.resize(next);
}

/// Makes the mean inverse depth of the corners 1. @return false when it is not positive
bool normalizeScale(InitialMap& map) {
  double mean = 0;
  for (const Corner& corner : map.corners) {
    mean += corner.inverse_depth / static_cast<double>(map.corners.size());
  }
  if (!(mean > 0) || !std::isfinite(mean)) {
    return false;
  }
  for (Corner& corner : map.corners) {
    corner.inverse_depth /= mean;
  }
  for (SemiDensePoint& point : map.points) {
    point.inverse_depth /= static_cast<float>(mean);
    point.variance /= static_cast<float>(mean * mean);
  }
  for (std::optional<SE3>& pose : map.T_cam_ref) {
    if (pose) {
      pose->setTranslation(pose->translation() * mean);
    }
  }
  return true;
}

/// Severe outliers with a new solution after each removal, then normal ones.
/// @return false when the attempt fails
bool solveAndRemove(Adjustment& adjustment,
                    const GeometricOptions& options,
                    GeometricReport& report) {
  const auto solve = [&]() {
    const std::optional<int> iterations =
        adjustment.remaining() >= options.min_points ? adjustment.solve() : std::nullopt;
    report.rounds += 1;
    report.iterations += iterations.value_or(0);
    return iterations.has_value();
  };
  // Ceres cannot start from a point behind a camera.
  report.removed_severe = adjustment.removeAbove(std::numeric_limits<double>::max());
  int removed = 0;
  do {
    if (!solve()) {
      return false;
    }
    removed = adjustment.removeAbove(options.severe_limit);
    report.removed_severe += removed;
  } while (removed > 0 && report.rounds < options.max_rounds);
  removed = adjustment.removeAbove(options.normal_limit);
  report.removed_normal = removed;
  while (removed > 0 && report.rounds < options.max_rounds) {
    if (!solve()) {
      return false;
    }
    removed = adjustment.removeAbove(options.normal_limit);
    report.removed_normal += removed;
  }
  return adjustment.remaining() >= options.min_points;
}

}  // namespace

GeometricReport adjustGeometry(InitialMap& map,
                               const PinholeCamera& camera,
                               const GeometricOptions& options) {
  GeometricReport report;
  Adjustment adjustment(map, camera, options);
  report.removed_unseen = adjustment.unseen();
  if (!solveAndRemove(adjustment, options, report)) {
    return report;
  }
  report.residual_rms = adjustment.residualRms();
  adjustment.writeBack();
  if (!normalizeScale(map)) {
    return report;
  }
  report.variance_factor = setCovariances(map, camera, options);
  report.usable = std::isfinite(report.variance_factor);
  return report;
}

}  // namespace dsorb::init_orb
