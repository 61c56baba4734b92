// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/bundle/rolling_equations.h"

#include "base/parallel.h"
#include "base/target_clones.h"
#include "estimate/levenberg_marquardt.h"
#include "estimate/schur_problem.h"
#include "estimate/triangle_sums.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>

namespace dsorb::init_orb {
namespace {

constexpr int kMotionSize = MotionRows::kMotionSize;
using Motion = Eigen::Matrix<double, kMotionSize, 1>;
constexpr int kPairs = kFactors * (kFactors + 1) / 2;

/// Poses, inverse depths, and what is added to the map's motions: one a posed frame, then that of
/// the reference.
struct RollingState {
  ReprojectionState geometry;
  std::vector<Motion> motion_change;
};

/// Left increment of a pose by a motion until a row's time.
Vector6d until(double time, const Motion& motion) {
  return time * (motion.head<6>() + 0.5 * time * motion.tail<6>());
}

/// Entries of a triangle of sums by the six of a pose, filled up to whole lanes.
constexpr std::size_t kTriangle = (triangleSums(kPoseSize) + 3) / 4 * 4;

/// Adds a triangle times the product of every pair of factors.
DSORB_TARGET_CLONES void addByPairs(const double* pairs, const double* triangle, double* sums) {
  for (int pair = 0; pair < kPairs; ++pair) {
    for (std::size_t i = 0; i < kTriangle; ++i) sums[i] += pairs[pair] * triangle[i];
    sums += kTriangle;
  }
}

/// Sums over the corners that a frame sees; derivatives are those by its pose.
struct FrameSums {
  std::array<double, kPairs * kTriangle> triangles{};  // times both factors of a pair, row by row
  double cost = 0;
  double weighted_square = 0;
  int observations = 0;

  void add(const MotionFactors& factors,
           const Eigen::Matrix<double, 2, kPoseSize>& J,
           double weight,
           const Eigen::Vector2d& error) {
    std::array<double, kTriangle> triangle{};
    for (int i = 0; i < 2; ++i) {
      const Vector6d row = J.row(i).transpose();
      addToTriangle<kPoseSize>(row.data(), weight, error[i], triangle.data());
    }
    std::array<double, kPairs> pairs{};
    std::size_t pair = 0;
    for (int r = 0; r < kFactors; ++r) {
      for (int c = r; c < kFactors; ++c) pairs[pair++] = factors[r] * factors[c];
    }
    addByPairs(pairs.data(), triangle.data(), triangles.data());
  }
  FrameSums& operator+=(const FrameSums& other) {
    for (std::size_t i = 0; i < triangles.size(); ++i) triangles[i] += other.triangles[i];
    cost += other.cost;
    weighted_square += other.weighted_square;
    observations += other.observations;
    return *this;
  }
};

/// The increments of a factor's unknown as increments of the frame's pose.
Matrix6d toPose(int factor, const Matrix6d& adjoint) {
  return factor < 3 ? Matrix6d(Matrix6d::Identity()) : adjoint;
}

/// Adds a frame's sums to the system of all unknowns. The first factor is 1: its pairs hold the
/// gradients by all others.
void addFrame(const FrameSums& sums,
              const Matrix6d& adjoint,
              const std::array<int, kFactors>& rows,
              LinearSystem<double>& system) {
  const double* triangle = sums.triangles.data();
  for (int r = 0; r < kFactors; ++r) {
    const int row = rows[static_cast<std::size_t>(r)];
    for (int c = r; c < kFactors; ++c, triangle += kTriangle) {
      const int column = rows[static_cast<std::size_t>(c)];
      Matrix6d H = Matrix6d::Zero();
      Vector6d b = Vector6d::Zero();
      addTriangle(triangle, 0, kPoseSize, H, b);
      H.triangularView<Eigen::StrictlyLower>() = H.transpose();
      const Matrix6d to = toPose(c, adjoint);
      const Matrix6d block = toPose(r, adjoint).transpose() * H * to;
      system.H.block<kPoseSize, kPoseSize>(row, column) += block;
      if (c > r) system.H.block<kPoseSize, kPoseSize>(column, row) += block.transpose();
      if (r == 0) system.b.segment<kPoseSize>(column) += to.transpose() * b;
    }
  }
}

class RollingProblem {
 public:
  RollingProblem(const InitialMap& map,
                 const PoseRows& pose_rows,
                 const PinholeCamera& camera,
                 const GeometricOptions& options)
      : map_(map),
        pose_rows_(pose_rows),
        rows_{pose_rows.size},
        camera_(camera),
        options_(options),
        times_(map, camera),
        known_(map, pose_rows),
        first_(map.corners.size() + 1, 0) {
    for (const CornerObservation& observation : map.observations) ++first_[observation.corner + 1];
    for (std::size_t i = 1; i < first_.size(); ++i) first_[i] += first_[i - 1];
  }

  [[nodiscard]] RollingState start() const {
    return {ReprojectionState(map_, pose_rows_),
            std::vector<Motion>(static_cast<std::size_t>(rows_.of_poses / kPoseSize) + 1,
                                Motion::Zero())};
  }

  void linearize(const RollingState& state, ReprojectionEquations& equations) const;

  void move(const RollingState& from, const DampedSolver& solution, RollingState& to) const {
    to.geometry.moveFrom(from.geometry, solution);
    for (std::size_t f = 0; f < from.motion_change.size(); ++f) {
      const int at = rows_.of(static_cast<int>(f) * kPoseSize);
      to.motion_change[f] = from.motion_change[f] + solution.step().segment<kMotionSize>(at);
    }
  }

  void writeTo(InitialMap& map, const RollingState& state) const;

 private:
  /// Index of a frame's motion; none where the frame takes no part.
  [[nodiscard]] std::optional<std::size_t> indexOf(std::size_t frame) const {
    const int row = frame == 0 ? rows_.of_poses : pose_rows_.first[frame];
    return row < 0 ? std::nullopt : std::optional(static_cast<std::size_t>(row / kPoseSize));
  }
  void addCorner(std::size_t corner,
                 const RollingState& state,
                 const std::vector<Matrix6d>& adjoints,
                 LinearSystem<double>& system,
                 FrameSums* sums) const;
  void addPriors(const RollingState& state, ReprojectionEquations& equations) const;

  const InitialMap& map_;
  const PoseRows& pose_rows_;
  MotionRows rows_;
  const PinholeCamera& camera_;
  const GeometricOptions& options_;
  RowTimesOfMap times_;
  KnownTerms known_;
  std::vector<std::size_t> first_;  // observation of each corner
};

void RollingProblem::addCorner(std::size_t corner,
                               const RollingState& state,
                               const std::vector<Matrix6d>& adjoints,
                               LinearSystem<double>& system,
                               FrameSums* sums) const {
  Eigen::Map<Eigen::VectorXd> coupling(system.coupling.data() + corner * system.stride,
                                       system.size());
  coupling.setZero();
  const Eigen::Vector3d ray = camera_.unproject(map_.corners[corner].pixel);
  const Vector6d of_host = until(times_.host[corner], state.motion_change.back());
  for (std::size_t i = first_[corner]; i < first_[corner + 1]; ++i) {
    const CornerObservation& observation = map_.observations[i];
    const std::optional<std::size_t> frame = indexOf(observation.frame);
    if (!frame) continue;
    FrameSums& sum = sums[*frame];
    const Vector6d moved =
        until(times_.target[i], state.motion_change[*frame]) - adjoints[*frame] * of_host;
    const auto projection = projectHosted(camera_,
                                          SE3::exp(moved) * state.geometry.T_cam_ref[*frame],
                                          ray,
                                          state.geometry.inverse_depth[corner]);
    if (!projection) {
      sum.cost = std::numeric_limits<double>::infinity();
      continue;
    }
    const Eigen::Matrix2d whitening = observation.whitening / options_.sigma;
    const Eigen::Vector2d error = whitening * (projection->pixel - observation.pixel);
    const Eigen::Matrix<double, 2, kPoseSize> J = whitening * projection->J_pose;
    const Eigen::Vector2d J_depth = whitening * projection->J_inverse_depth;
    const double norm = error.norm();
    const double weight = robustWeight(norm, options_);
    const MotionFactors factors = motionFactors(times_.target[i], times_.host[corner]);
    sum.add(factors, J, weight, error);
    sum.cost += robustCost(norm, options_);
    sum.weighted_square += weight * norm * norm;
    ++sum.observations;
    addByFactors(weight * J.transpose() * J_depth,
                 factors,
                 adjoints[*frame],
                 rows_.ofFactors(pose_rows_.first[observation.frame]),
                 coupling);
    system.depth_hessian[corner] += weight * J_depth.squaredNorm();
    system.depth_gradient[corner] += weight * J_depth.dot(error);
  }
}

void RollingProblem::addPriors(const RollingState& state, ReprojectionEquations& equations) const {
  for (std::size_t k = 0; k < map_.frames.size(); ++k) {
    const std::optional<std::size_t> index = indexOf(k);
    if (!index) continue;
    const int at = rows_.of(static_cast<int>(*index) * kPoseSize);
    const auto& [found, prior] = map_.motions[k];
    Motion sigma;
    Motion error;
    sigma << prior.sigma, prior.acceleration_sigma;
    error << found.velocity - prior.mean.velocity, found.acceleration - prior.mean.acceleration;
    error += state.motion_change[*index];
    const Motion information = sigma.cwiseAbs2().cwiseInverse();
    equations.system.H.diagonal().segment<kMotionSize>(at) += information;
    equations.system.b.segment<kMotionSize>(at) += information.cwiseProduct(error);
    const double square = error.dot(information.cwiseProduct(error));
    equations.cost += 0.5 * square;
    equations.weighted_square += square;
    equations.rows += kMotionSize;
  }
}

void RollingProblem::linearize(const RollingState& state, ReprojectionEquations& equations) const {
  LinearSystem<double>& system = equations.system;
  system.reset(rows_.size(), state.geometry.inverse_depth.size());
  std::vector<Matrix6d> adjoints;
  for (const SE3& pose : state.geometry.T_cam_ref) adjoints.push_back(pose.adjoint());
  const std::size_t frames = adjoints.size();
  const std::size_t corners = map_.corners.size();
  const std::size_t blocks = (corners + kCornerBlock - 1) / kCornerBlock;
  std::vector<FrameSums> partial(blocks * frames);
  forEachRange(blocks, 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t block = begin; block < end; ++block) {
      const std::size_t first = block * kCornerBlock;
      const std::size_t last = std::min(corners, first + kCornerBlock);
      for (std::size_t i = first; i < last; ++i) {
        addCorner(i, state, adjoints, system, partial.data() + block * frames);
      }
    }
  });
  equations.cost = 0;
  equations.weighted_square = 0;
  equations.rows = 0;
  for (std::size_t f = 0; f < frames; ++f) {
    FrameSums sums;
    for (std::size_t block = 0; block < blocks; ++block) sums += partial[block * frames + f];
    addFrame(sums, adjoints[f], rows_.ofFactors(static_cast<int>(f) * kPoseSize), system);
    equations.cost += sums.cost;
    equations.weighted_square += sums.weighted_square;
    equations.rows += 2 * sums.observations;
  }
  addPriors(state, equations);
  known_.addTo(equations, state.geometry);
}

void RollingProblem::writeTo(InitialMap& map, const RollingState& state) const {
  for (std::size_t i = 0; i < map.observations.size(); ++i) {
    CornerObservation& observation = map.observations[i];
    if (pose_rows_.first[observation.frame] < 0) continue;
    const std::size_t frame = *indexOf(observation.frame);
    const auto projection = projectCorner(map, camera_, observation);
    if (!projection) continue;
    observation.pixel -= projection->J_pose * until(times_.target[i], state.motion_change[frame]);
  }
  for (std::size_t k = 0; k < map.frames.size(); ++k) {
    const std::optional<std::size_t> index = indexOf(k);
    if (!index) continue;
    map.motions[k].found.velocity += state.motion_change[*index].head<6>();
    map.motions[k].found.acceleration += state.motion_change[*index].tail<6>();
  }
  state.geometry.writeTo(map, pose_rows_);
  placeCorners(map, camera_);
}

}  // namespace

RowTimesOfMap::RowTimesOfMap(const InitialMap& map, const PinholeCamera& camera)
    : host(map.corners.size()), target(map.observations.size()) {
  const auto time_at = [](const RollingShutter& shutter, const Eigen::Vector2f& pixel) {
    float time = 0;
    rowTime(shutter, pixel.x(), pixel.y(), time);
    return static_cast<double>(time);
  };
  std::vector<RollingShutter> shutters;
  for (std::size_t k = 0; k < map.frames.size(); ++k) shutters.push_back(*shutterOf(map, k));
  for (std::size_t i = 0; i < host.size(); ++i) {
    host[i] = time_at(shutters.front(), map.corners[i].seen());
  }
  for (std::size_t i = 0; i < target.size(); ++i) {
    const CornerObservation& observation = map.observations[i];
    const auto depth = static_cast<float>(map.corners[observation.corner].inverse_depth);
    const RollingShutter& shutter = shutters[observation.frame];
    const Eigen::Vector2f pixel = observation.pixel.cast<float>();
    target[i] = time_at(shutter, pixelInRow(shutter, camera, pixel, depth));
  }
}

void addByFactors(const Vector6d& by_pose,
                  const MotionFactors& factors,
                  const Matrix6d& adjoint,
                  const std::array<int, kFactors>& rows,
                  Eigen::Ref<Eigen::VectorXd> all) {
  const Vector6d of_reference = adjoint.transpose() * by_pose;
  for (int k = 0; k < kFactors; ++k) {
    all.segment<kPoseSize>(rows[static_cast<std::size_t>(k)]) +=
        factors[k] * (k < 3 ? by_pose : of_reference);
  }
}

void scaleMotions(const InitialMap& map, const PoseRows& pose_rows, Eigen::VectorXd& direction) {
  const MotionRows rows{pose_rows.size};
  for (std::size_t k = 0; k < map.frames.size(); ++k) {
    const int row = k == 0 ? rows.of_poses : pose_rows.first[k];
    if (row < 0) continue;
    direction.segment<3>(rows.of(row)) = map.motions[k].found.velocity.head<3>();
    direction.segment<3>(rows.of(row) + kPoseSize) = map.motions[k].found.acceleration.head<3>();
  }
}

ReprojectionEquations linearizeRolling(const InitialMap& map,
                                       const PoseRows& pose_rows,
                                       const PinholeCamera& camera,
                                       const GeometricOptions& options) {
  ReprojectionEquations equations;
  const RollingProblem problem(map, pose_rows, camera, options);
  problem.linearize(problem.start(), equations);
  return equations;
}

std::optional<int> solveRolling(InitialMap& map,
                                const PinholeCamera& camera,
                                const GeometricOptions& options,
                                const Stopping& stopping) {
  const PoseRows pose_rows(map);
  if (pose_rows.size == 0) return std::nullopt;
  const RollingProblem problem(map, pose_rows, camera, options);
  SchurProblem<const RollingProblem&, RollingState, ReprojectionEquations> adjustment(
      problem, problem.start(), stopping);
  const std::optional<int> iterations = minimize(adjustment, stopping);
  if (!iterations) return std::nullopt;
  const RollingState found = adjustment.state();
  problem.writeTo(map, found);
  return iterations;
}

}  // namespace dsorb::init_orb
