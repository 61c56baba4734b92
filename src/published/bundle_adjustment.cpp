// SPDX-License-Identifier: BSD-3-Clause
#include "published/bundle_adjustment.h"

#include "estimate/warp.h"
#include "init/orb/bundle/geometric_covariance.h"
#include "init/result.h"

#include <ceres/ordered_groups.h>
#include <ceres/solver.h>
#include <ceres/version.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numeric>
#include <utility>

#if CERES_VERSION_MAJOR > 2 || CERES_VERSION_MINOR > 0
#include <ceres/manifold.h>
#else
#include <ceres/local_parameterization.h>
#endif

namespace dsorb::published {
namespace {

constexpr double kSevereLimit = 8;  // of an error; corners above it go with a new solution [px]
constexpr double kNormalLimit = 3;  // once the severe errors are gone [px]
constexpr std::size_t kMinAdjusted = 50;  // corners; with fewer left an attempt fails
constexpr int kMaxRounds = 10;            // of solving and removing corners
constexpr int kMaxIterations = 20;        // of one solve

#if CERES_VERSION_MAJOR > 2 || CERES_VERSION_MINOR > 0
class PoseManifold final : public ceres::Manifold {
 public:
  [[nodiscard]] int AmbientSize() const override { return 7; }
  [[nodiscard]] int TangentSize() const override { return 6; }
  bool PlusJacobian(const double* /*x*/, double* jacobian) const override {
    Eigen::Map<Eigen::Matrix<double, 7, 6, Eigen::RowMajor>>(jacobian, 7, 6).setIdentity();
    return true;
  }
  bool Minus(const double* y, const double* x, double* y_minus_x) const override {
    Eigen::Map<Vector6d>(y_minus_x, 6) = (fromBlock(y) * fromBlock(x).inverse()).log();
    return true;
  }
  bool MinusJacobian(const double* /*x*/, double* jacobian) const override {
    Eigen::Map<Eigen::Matrix<double, 6, 7, Eigen::RowMajor>>(jacobian, 6, 7).setIdentity();
    return true;
  }
#else  // Ceres 2.0
class PoseManifold final : public ceres::LocalParameterization {
 public:
  [[nodiscard]] int GlobalSize() const override { return 7; }
  [[nodiscard]] int LocalSize() const override { return 6; }
  bool ComputeJacobian(const double* /*x*/, double* jacobian) const override {
    Eigen::Map<Eigen::Matrix<double, 7, 6, Eigen::RowMajor>>(jacobian, 7, 6).setIdentity();
    return true;
  }
#endif
  bool Plus(const double* x, const double* delta, double* x_plus_delta) const override {
    const PoseBlock moved = toBlock(SE3::exp(Eigen::Map<const Vector6d>(delta)) * fromBlock(x));
    std::copy(moved.begin(), moved.end(), x_plus_delta);
    return true;
  }
};

bool isFinite(const Solved& solved) {
  return std::all_of(solved.poses.begin(),
                     solved.poses.end(),
                     [](const SE3& pose) { return pose.matrix().allFinite(); }) &&
         std::all_of(solved.inverse_depths.begin(), solved.inverse_depths.end(), [](double depth) {
           return std::isfinite(depth);
         });
}

bool performGeometricBA(Map& map, const PinholeCamera& camera, GeometricReport& report) {
  ++report.rounds;
  if (map.corners < kMinAdjusted) return false;
  std::vector<std::size_t> corners(map.corners);
  std::iota(corners.begin(), corners.end(), std::size_t{0});
  std::vector<double> inverse_depths;
  for (const std::size_t i : corners) inverse_depths.push_back(map.points[i].inverse_depth);
  CeresAdjustment adjustment(map.poses(), inverse_depths);
  auto* loss = new ceres::HuberLoss(kCornerHuber);  // the problem owns it
  for (const Observation& seen : map.observations) {
    const Eigen::Vector3d ray = camera.unproject(map.points[seen.corner].pixel.cast<double>());
    adjustment.add(
        new ReprojectionCost(camera, ray, seen.pixel), loss, seen.frame - 1, seen.corner);
  }
  const std::optional<Solved> solved = adjustment.solve(kMaxIterations);
  if (solved) write(*solved, corners, map);
  return solved.has_value();
}

/// Distance between where a corner is expected and where it was seen [px]; infinite behind the
/// camera.
double reprojectionError(const Map& map, const PinholeCamera& camera, const Observation& seen) {
  const MapPoint& corner = map.points[seen.corner];
  const Eigen::Vector3d ray = camera.unproject(corner.pixel.cast<double>());
  const auto projection = projectHosted(camera, map.pose(seen.frame), ray, corner.inverse_depth);
  return projection ? (projection->pixel - seen.pixel).norm()
                    : std::numeric_limits<double>::infinity();
}

/// Removes corners with a larger error than `limit` [px] in any frame, and corners behind the
/// reference. @return their number
int removeAbove(Map& map, const PinholeCamera& camera, double limit) {
  std::vector<char> removed(map.points.size(), 0);
  for (const Observation& seen : map.observations) {
    if (reprojectionError(map, camera, seen) > limit) removed[seen.corner] = 1;
  }
  for (std::size_t i = 0; i < map.corners; ++i) {
    if (!(map.points[i].inverse_depth > 0)) removed[i] = 1;
  }
  return removePoints(map, removed);
}

/// Iterates optimization and removal until no severe outlier is left, then with normal ones.
/// @return whether all solutions were usable
bool solveAndRemove(Map& map, const PinholeCamera& camera, GeometricReport& report) {
  // No solver can start from a point behind a camera.
  report.removed_severe = removeAbove(map, camera, std::numeric_limits<double>::max());
  int removed = 0;
  do {
    if (!performGeometricBA(map, camera, report)) return false;
    removed = removeAbove(map, camera, kSevereLimit);
    report.removed_severe += removed;
  } while (removed > 0 && report.rounds < kMaxRounds);
  removed = removeAbove(map, camera, kNormalLimit);
  report.removed_normal = removed;
  while (removed > 0 && report.rounds < kMaxRounds) {
    if (!performGeometricBA(map, camera, report)) return false;
    removed = removeAbove(map, camera, kNormalLimit);
    report.removed_normal += removed;
  }
  return map.corners >= kMinAdjusted;
}

}  // namespace

std::vector<SE3> Map::poses() const {
  std::vector<SE3> poses;
  for (std::size_t k = 1; k < frames.size(); ++k) poses.push_back(pose(k));
  return poses;
}

int removePoints(Map& map, const std::vector<char>& removed) {
  std::vector<std::size_t> new_index;
  std::vector<MapPoint> kept;
  const std::size_t before = map.corners;
  for (std::size_t i = 0; i < map.points.size(); ++i) {
    if (i == before) map.corners = kept.size();
    new_index.push_back(kept.size());
    if (removed[i] == 0) kept.push_back(map.points[i]);
  }
  if (before == map.points.size()) map.corners = kept.size();
  map.points = std::move(kept);
  std::vector<Observation> observations;
  for (const Observation& seen : map.observations) {
    if (removed[seen.corner] != 0) continue;
    observations.push_back({new_index[seen.corner], seen.frame, seen.pixel});
  }
  map.observations = std::move(observations);
  return static_cast<int>(before - map.corners);
}

bool normalizeScale(Map& map, std::size_t count) {
  double sum = 0;
  for (std::size_t i = 0; i < count; ++i) sum += map.points[i].inverse_depth;
  const double mean = sum / static_cast<double>(count);
  if (!(mean > 0) || !std::isfinite(mean)) return false;
  for (MapPoint& point : map.points) changeUnit(mean, point.inverse_depth, point.variance);
  changeUnit(mean, map.frames);
  return true;
}

PoseBlock toBlock(const SE3& pose) {
  const Eigen::Quaterniond& q = pose.unitQuaternion();
  const Eigen::Vector3d& t = pose.translation();
  return {q.x(), q.y(), q.z(), q.w(), t.x(), t.y(), t.z()};
}

SE3 fromBlock(const double* block) {
  return {Eigen::Quaterniond(block[3], block[0], block[1], block[2]),
          Eigen::Vector3d(block[4], block[5], block[6])};
}

void setPoseManifold(ceres::Problem& problem, double* pose) {
#if CERES_VERSION_MAJOR > 2 || CERES_VERSION_MINOR > 0
  problem.SetManifold(pose, new PoseManifold);
#else
  problem.SetParameterization(pose, new PoseManifold);
#endif
}

CeresAdjustment::CeresAdjustment(const std::vector<SE3>& poses, std::vector<double> inverse_depths)
    : inverse_depths_(std::move(inverse_depths)) {
  for (const SE3& pose : poses) poses_.push_back(toBlock(pose));
}

void CeresAdjustment::add(ceres::CostFunction* cost,
                          ceres::LossFunction* loss,
                          std::size_t pose,
                          std::size_t point) {
  problem_.AddResidualBlock(cost, loss, poses_[pose].data(), &inverse_depths_[point]);
}

std::optional<Solved> CeresAdjustment::solve(int max_iterations, double cost_change) {
  auto ordering = std::make_shared<ceres::ParameterBlockOrdering>();
  for (double& depth : inverse_depths_) {
    if (problem_.HasParameterBlock(&depth)) ordering->AddElementToGroup(&depth, 0);
  }
  for (PoseBlock& pose : poses_) {
    if (!problem_.HasParameterBlock(pose.data())) continue;
    ordering->AddElementToGroup(pose.data(), 1);
    setPoseManifold(problem_, pose.data());
  }
  ceres::Solver::Options options;
  options.linear_solver_type = ceres::DENSE_SCHUR;
  options.linear_solver_ordering = std::move(ordering);
  options.max_num_iterations = max_iterations;
  options.function_tolerance = cost_change;
  options.num_threads = 1;
  options.logging_type = ceres::SILENT;
  ceres::Solver::Summary summary;
  ceres::Solve(options, &problem_, &summary);
  Solved solved{summary.initial_cost, summary.final_cost, {}, inverse_depths_};
  for (const PoseBlock& pose : poses_) solved.poses.push_back(fromBlock(pose.data()));
  if (!summary.IsSolutionUsable() || !isFinite(solved)) return std::nullopt;
  return solved;
}

void write(const Solved& solved, const std::vector<std::size_t>& points, Map& map) {
  for (std::size_t k = 1; k < map.frames.size(); ++k) map.frames[k].T_cam_ref = solved.poses[k - 1];
  for (std::size_t i = 0; i < points.size(); ++i) {
    map.points[points[i]].inverse_depth = solved.inverse_depths[i];
  }
}

GeometricReport adjustGeometry(Map& map, const PinholeCamera& camera) {
  GeometricReport report;
  if (!solveAndRemove(map, camera, report)) return report;
  double sum = 0;
  for (const Observation& seen : map.observations) {
    sum += std::pow(reprojectionError(map, camera, seen), 2);
  }
  report.residual_rms = std::sqrt(sum / static_cast<double>(2 * map.observations.size()));
  report.usable = normalizeScale(map, map.corners) && setCovariances(map, camera);
  return report;
}

bool ReprojectionCost::Evaluate(double const* const* parameters,
                                double* residuals,
                                double** jacobians) const {
  const auto seen = projectHosted(camera_, fromBlock(parameters[0]), ray_, parameters[1][0]);
  if (!seen) return false;
  Eigen::Map<Eigen::Vector2d>(residuals, 2) = seen->pixel - pixel_;
  if (jacobians == nullptr) return true;
  if (jacobians[0] != nullptr) {
    Eigen::Map<Eigen::Matrix<double, 2, 7, Eigen::RowMajor>>(jacobians[0], 2, 7) << seen->J_pose,
        Eigen::Vector2d::Zero();
  }
  if (jacobians[1] != nullptr) {
    Eigen::Map<Eigen::Vector2d>(jacobians[1], 2) = seen->J_inverse_depth;
  }
  return true;
}

init_orb::InitialMap cornersOf(const Map& map) {
  init_orb::InitialMap corners;
  corners.frames = map.frames;
  for (std::size_t i = 0; i < map.corners; ++i) {
    corners.corners.push_back({map.points[i].pixel.cast<double>(), map.points[i].inverse_depth});
  }
  for (const Observation& seen : map.observations) {
    corners.observations.push_back({seen.corner, seen.frame, seen.pixel});
  }
  return corners;
}

bool setCovariances(Map& map, const PinholeCamera& camera) {
  init_orb::InitialMap corners = cornersOf(map);
  const GeometricOptions adjusted{1, RobustLoss::kHuber, kCornerHuber};
  if (!std::isfinite(init_orb::setCovariances(corners, camera, adjusted))) return false;
  map.frames = std::move(corners.frames);
  for (std::size_t i = 0; i < map.corners; ++i) {
    map.points[i].variance = corners.corners[i].variance;
  }
  return true;
}

}  // namespace dsorb::published
