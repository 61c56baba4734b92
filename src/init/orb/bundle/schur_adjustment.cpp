// SPDX-License-Identifier: BSD-3-Clause
#include "base/parallel.h"
#include "init/orb/bundle/adjustment_solvers.h"
#include "init/orb/bundle/damping.h"
#include "init/orb/bundle/reprojection_equations.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

namespace dsorb::init_orb {
namespace {

constexpr double kMinGradient = 1e-10;  // largest entry at a minimum; default of Ceres

bool isMinimum(const ReprojectionSums& sums) {
  const auto small = [](double entry) { return std::abs(entry) < kMinGradient; };
  return std::all_of(sums.depth_gradient.begin(), sums.depth_gradient.end(), small) &&
         std::all_of(sums.poses.begin(), sums.poses.end(), [&](const PoseSums& pose) {
           return std::all_of(pose.gradient.begin(), pose.gradient.end(), small);
         });
}

/// Solves the equations with their diagonal scaled by 1 + damping; depths are eliminated. Allocates
/// at the first solution only.
class Elimination {
 public:
  /// @return decrease of the cost that the equations predict; nullopt when they are degenerate
  std::optional<double> solve(const ReprojectionSums& sums, double damping);

  /// @param state gets `from`, moved by the solution
  void move(const ReprojectionState& from, ReprojectionState& state) const;

 private:
  [[nodiscard]] std::size_t blocks() const {
    return (inverse_.size() + kCornerBlock - 1) / kCornerBlock;
  }
  [[nodiscard]] CouplingRun run(const ReprojectionSums& sums, std::size_t block) const;
  void eliminate(const ReprojectionSums& sums);

  std::vector<double> inverse_;  // of the damped depth Hessian, by corner
  std::vector<double> partial_;  // by block: matrix, then vector
  Eigen::MatrixXd schur_;        // lower triangle
  Eigen::VectorXd right_;
  Eigen::VectorXd poses_;       // left increments, 6 a posed frame
  std::vector<double> depths_;  // one a corner
};

CouplingRun Elimination::run(const ReprojectionSums& sums, std::size_t block) const {
  const std::size_t first = block * kCornerBlock;
  return {sums.coupling.data() + first,
          sums.poses.size() * kPoseSize,
          sums.stride,
          inverse_.data() + first,
          sums.depth_gradient.data() + first,
          std::min(kCornerBlock, inverse_.size() - first)};
}

void Elimination::eliminate(const ReprojectionSums& sums) {
  const std::size_t size = sums.poses.size() * kPoseSize;
  const std::size_t part = size * size + size;
  partial_.assign(blocks() * part, 0);
  forEachRange(blocks(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t block = begin; block < end; ++block) {
      double* matrix = &partial_[block * part];
      eliminateCorners(run(sums, block), matrix, matrix + size * size);
    }
  });
  for (std::size_t block = 0; block < blocks(); ++block) {
    const double* matrix = &partial_[block * part];
    for (std::size_t r = 0; r < size; ++r) {
      const auto row = static_cast<Eigen::Index>(r);
      for (Eigen::Index c = 0; c <= row; ++c) schur_(row, c) -= matrix[r * size + std::size_t(c)];
      right_[row] -= matrix[size * size + r];
    }
  }
}

std::optional<double> Elimination::solve(const ReprojectionSums& sums, double damping) {
  const auto size = static_cast<Eigen::Index>(sums.poses.size()) * kPoseSize;
  schur_.setZero(size, size);
  right_.resize(size);
  for (Eigen::Index at = 0; at < size; at += kPoseSize) {
    const PoseSums& pose = sums.poses[static_cast<std::size_t>(at / kPoseSize)];
    schur_.block<kPoseSize, kPoseSize>(at, at) = hessianOf(pose);
    right_.segment<kPoseSize>(at) = Eigen::Map<const Vector6d>(pose.gradient.data());
  }
  const Eigen::VectorXd diagonal = schur_.diagonal();
  const Eigen::VectorXd gradient = right_;
  schur_.diagonal() += damping * diagonal;
  inverse_.resize(sums.stride);
  std::transform(
      sums.depth_hessian.begin(), sums.depth_hessian.end(), inverse_.begin(), [damping](double h) {
        return h > 0 ? 1 / ((1 + damping) * h) : 0.0;
      });
  eliminate(sums);
  const Eigen::LLT<Eigen::Ref<Eigen::MatrixXd>, Eigen::Lower> cholesky(schur_);
  if (cholesky.info() != Eigen::Success) return std::nullopt;
  poses_ = -cholesky.solve(right_);
  depths_.resize(sums.stride);
  double decrease = poses_.dot(damping * diagonal.cwiseProduct(poses_) - gradient);
  forEachRange(blocks(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t block = begin; block < end; ++block) {
      substituteBack(run(sums, block), poses_.data(), &depths_[block * kCornerBlock]);
    }
  });
  for (std::size_t i = 0; i < depths_.size(); ++i) {
    decrease +=
        depths_[i] * (damping * sums.depth_hessian[i] * depths_[i] - sums.depth_gradient[i]);
  }
  return std::isfinite(decrease) ? std::optional(0.5 * decrease) : std::nullopt;
}

void Elimination::move(const ReprojectionState& from, ReprojectionState& state) const {
  for (std::size_t f = 0; f < from.T_cam_ref.size(); ++f) {
    const Vector6d increment = poses_.segment<kPoseSize>(static_cast<Eigen::Index>(f) * kPoseSize);
    state.T_cam_ref[f] = SE3::exp(increment) * from.T_cam_ref[f];
  }
  for (std::size_t i = 0; i < depths_.size(); ++i) {
    state.inverse_depth[i] = from.inverse_depth[i] + depths_[i];
  }
}

}  // namespace

std::optional<int> solveWithSchur(InitialMap& map,
                                  const std::vector<char>& kept,
                                  const PinholeCamera& camera,
                                  const GeometricOptions& options) {
  const PoseRows pose_rows(map);
  if (pose_rows.size == 0) return std::nullopt;
  const ReprojectionProblem problem(map, kept, pose_rows, camera, options);
  ReprojectionState state(map, pose_rows);
  ReprojectionState moved = state;
  ReprojectionSums sums;
  ReprojectionSums moved_sums;
  Elimination elimination;
  Damping damping;
  problem.linearize(state, sums);
  if (sums.behind || !std::isfinite(sums.cost)) return std::nullopt;
  int iteration = 0;
  while (iteration < options.max_iterations && !damping.exhausted() && !isMinimum(sums)) {
    ++iteration;
    const std::optional<double> decrease = elimination.solve(sums, damping.value);
    if (decrease) {
      elimination.move(state, moved);
      problem.linearize(moved, moved_sums);
    }
    if (!decrease || moved_sums.behind || !(moved_sums.cost <= sums.cost)) {
      if (decrease && *decrease < options.function_tolerance * sums.cost) break;
      damping.fail();
      continue;
    }
    const double change = sums.cost - moved_sums.cost;
    damping.succeed(*decrease > 0 ? change / *decrease : 0);
    const bool converged = change <= options.function_tolerance * sums.cost;
    std::swap(state, moved);
    std::swap(sums, moved_sums);
    if (converged) break;
  }
  state.writeTo(map, pose_rows);
  return iteration;
}

}  // namespace dsorb::init_orb
