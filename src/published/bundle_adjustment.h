// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"

#include "init/orb/map/initial_map.h"
#include "published/structure.h"

#include <ceres/cost_function.h>
#include <ceres/loss_function.h>
#include <ceres/problem.h>
#include <ceres/sized_cost_function.h>

#include <array>
#include <cstddef>
#include <optional>
#include <vector>

namespace dsorb::published {

/// Pose as Ceres sees it: quaternion (x, y, z, w), translation.
using PoseBlock = std::array<double, 7>;

[[nodiscard]] PoseBlock toBlock(const SE3& pose);
[[nodiscard]] SE3 fromBlock(const double* block);
/// Tells a problem that a PoseBlock moves by exp([translation; rotation]) from the left. Costs
/// differentiate by that increment: in the first six columns of their Jacobian, the seventh is 0.
void setPoseManifold(ceres::Problem& problem, double* pose);

/// What a bundle adjustment has found.
struct Solved {
  double first_cost = 0;
  double cost = 0;
  std::vector<SE3> poses;
  std::vector<double> inverse_depths;
};

/// A bundle adjustment of poses and inverse depths by Ceres. The scale stays about where it was.
class CeresAdjustment {
 public:
  CeresAdjustment(const std::vector<SE3>& poses, std::vector<double> inverse_depths);

  /// Adds residuals. @param cost a new one, its parameters a PoseBlock and an inverse depth
  /// @param loss of the squared residual, a new one for all costs; or null
  void add(ceres::CostFunction* cost,
           ceres::LossFunction* loss,
           std::size_t pose,
           std::size_t point);

  /// Solves by dense Schur elimination of the inverse depths; silent, and on one thread: with more
  /// the sums have no fixed order.
  /// @param cost_change less than this share of the cost is the end; default of Ceres
  /// @return nullopt without usable numbers
  std::optional<Solved> solve(int max_iterations, double cost_change = 1e-6);

 private:
  std::vector<PoseBlock> poses_;
  std::vector<double> inverse_depths_;
  ceres::Problem problem_;
};

/// Puts what was found into a map. @param points those that the inverse depths are of
void write(const Solved& solved, const std::vector<std::size_t>& points, Map& map);

/// Reprojection error of one corner in one frame [px]; parameters: pose, inverse depth. Evaluation
/// fails when the point is not in front of the camera.
class ReprojectionCost final : public ceres::SizedCostFunction<2, 7, 1> {
 public:
  /// @param ray   of the corner in the reference, z = 1
  /// @param pixel observed [px]
  ReprojectionCost(PinholeCamera camera, Eigen::Vector3d ray, Eigen::Vector2d pixel)
      : camera_(camera), ray_(std::move(ray)), pixel_(std::move(pixel)) {}

  bool Evaluate(double const* const* parameters,
                double* residuals,
                double** jacobians) const override;

 private:
  PinholeCamera camera_;
  Eigen::Vector3d ray_;
  Eigen::Vector2d pixel_;
};

struct GeometricReport {
  bool usable = false;      ///< enough corners left, all numbers finite
  int rounds = 0;           ///< solves
  int removed_severe = 0;   ///< corners: far off or behind a camera
  int removed_normal = 0;   ///< corners above the normal limit
  double residual_rms = 0;  ///< of one coordinate, corners that stayed [px]
};

/// Adjusts the poses of all frames but the first and the inverse depths of all corners to the
/// observed corners, and removes outliers. Afterwards the mean inverse depth of the corners is 1;
/// the covariances of frames and the corners' variances are set.
/// @param map corners with inverse depths to start from; half adjusted where the report is not
///            usable
/// @source [Gladkova], section 3.2
GeometricReport adjustGeometry(Map& map, const PinholeCamera& camera);

constexpr double kCornerHuber = 2.4474;  ///< sqrt(5.99): 95 % of chi-square, 2 degrees of freedom

/// The corners of a map as `orb` has them.
init_orb::InitialMap cornersOf(const Map& map);

/// Sets the covariances of frames and the variances of corners, which the thesis does not hand
/// over, as `orb` does.
/// @param map adjusted, mean inverse depth 1
/// @return false where the problem has no redundancy or is degenerate; nothing is set then
bool setCovariances(Map& map, const PinholeCamera& camera);

}  // namespace dsorb::published
