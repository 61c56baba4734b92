// SPDX-License-Identifier: BSD-3-Clause
#include "base/median.h"
#include "estimate/marginals.h"
#include "estimate/robust_loss.h"
#include "estimate/warp.h"
#include "image/cell_grid.h"
#include "published/bundle_adjustment.h"
#include "published/photometric.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace dsorb::published {
namespace {

/// Relative growth of the covariance by cells per unit by which the tails of the errors exceed a
/// Gaussian's [-].
constexpr double kTailVarianceFactor = 4;
constexpr double kTailShare = 0.9;
constexpr double kNormalTail = 2.4387;     // that quantile over the median of a normal |error|
constexpr double kPoseVarianceFactor = 6;  // on the covariance by cells of photometric poses [-]
constexpr double kMatchError = 0.1;        // error that all frames share, along a gradient [px]
/// A patch is taken to be as deep everywhere. Where the surface slants, the edges that tell its
/// depth lie beside its centre: a share of the inverse depth.
constexpr double kSlantError = 0.006;

template <int kRows>
using Column = Eigen::Matrix<double, kRows, 1>;

/// Robustly weighted normal equations over poses (left increments) and the inverse depths of some
/// points, and what each cell of the image adds to the gradient of the poses.
class Equations {
 public:
  Equations(const Map& map, const PinholeCamera& camera, const std::vector<std::size_t>& points)
      : poses_(map.poses()) {
    const CellGrid grid = errorCells(camera.width, camera.height);
    std::vector<Eigen::Index> column(grid.size(), -1);
    Eigen::Index columns = 0;
    for (const std::size_t i : points) {
      const MapPoint& point = map.points[i];
      Eigen::Index& cell = column[grid.at(point.pixel.x(), point.pixel.y())];
      if (cell < 0) cell = columns++;
      cell_.push_back(cell);
      inverse_depth.push_back(point.inverse_depth);
    }
    const auto size = static_cast<Eigen::Index>(6 * poses_.size());
    system.reset(size, points.size());
    gradients_ = Eigen::MatrixXd::Zero(size, columns);
  }

  /// Adds the residuals of a point in a frame. @param frame after the reference, from 0
  template <int kRows>
  void add(std::size_t frame,
           std::size_t point,
           const Eigen::Matrix<double, kRows, 6>& J_pose,
           const Column<kRows>& J_depth,
           const Column<kRows>& residual,
           const Column<kRows>& weight) {
    const auto at = static_cast<Eigen::Index>(6 * frame);
    const Eigen::Matrix<double, kRows, 6> J = weight.asDiagonal() * J_pose;
    const Column<kRows> weighted = weight.cwiseProduct(J_depth);
    const Vector6d gradient = J.transpose() * residual;
    system.H.block<6, 6>(at, at) += J.transpose() * J_pose;
    system.b.segment<6>(at) += gradient;
    gradients_.col(cell_[point]).template segment<6>(at) += gradient;
    Eigen::Map<Vector6d>(&system.coupling[point * system.stride + 6 * frame]) =
        J.transpose() * J_depth;
    system.depth_hessian[point] += weighted.dot(J_depth);
    system.depth_gradient[point] += weighted.dot(residual);
    weighted_square += weight.cwiseProduct(residual).dot(residual);
    rows += kRows;
  }

  [[nodiscard]] Eigen::VectorXd scale() const { return scaleDirection(poses_, 6); }
  [[nodiscard]] Marginals marginals() const { return {system, scale(), inverse_depth}; }
  /// Roots of the covariance by cells, before the gauge. @source Marginals::clusteredRoots()
  [[nodiscard]] Eigen::MatrixXd clusteredRoots(const Marginals& marginals) const {
    Eigen::MatrixXd gradients = gradients_;
    for (std::size_t i = 0; i < cell_.size(); ++i) {
      if (!system.known(i)) continue;
      gradients.col(cell_[i]) -=
          system.couplingOf(i) * (system.depth_gradient[i] / system.depth_hessian[i]);
    }
    return marginals.clusteredRoots(gradients, system.size() / 6);
  }

  LinearSystem<double> system;
  std::vector<double> inverse_depth;
  double weighted_square = 0;  // sum of w e^2
  int rows = 0;                // scalar residuals

 private:
  std::vector<SE3> poses_;
  std::vector<Eigen::Index> cell_;  // by point: column of gradients_
  Eigen::MatrixXd gradients_;
};

/// How much heavier the tails of the errors are than noise's [-]; at least 0.
/// @param across errors across the epipolar line, which no inverse depth absorbs
double tailExcess(std::vector<double> across) {
  const double median = medianInPlace(across);
  if (!(median > 0)) return 0;
  const double ratio = quantileInPlace(across, kTailShare) / (kNormalTail * median);
  return std::max(0.0, ratio * ratio - 1);
}

void setPoseCovariances(const Eigen::MatrixXd& joint, Map& map) {
  for (std::size_t k = 1; k < map.frames.size(); ++k) {
    const auto row = static_cast<Eigen::Index>(6 * (k - 1));
    map.frames[k].covariance = joint.block<6, 6>(row, row);
  }
}

/// Largest motion [px] along the gradients of a patch by a unit of inverse depth.
double speedOf(const Map& map,
               const PinholeCamera& camera,
               const MapPoint& point,
               const std::vector<char>& seen) {
  Eigen::Matrix2d tensor = Eigen::Matrix2d::Zero();
  for (const PatternOffset& offset : kPattern) {
    const Sample<float> sample = interpolate(map.frames.front().frame->level(0),
                                             point.pixel.x() + static_cast<float>(offset.x),
                                             point.pixel.y() + static_cast<float>(offset.y));
    const Eigen::Vector2d gradient = Eigen::Vector2f(sample.dx, sample.dy).cast<double>();
    tensor += gradient * gradient.transpose();
  }
  const Eigen::Vector3d ray = camera.unproject(point.pixel.cast<double>());
  double best = 0;
  for (std::size_t k = 1; k < map.frames.size(); ++k) {
    if (seen[k - 1] == 0) continue;
    const auto projection = projectHosted(camera, map.pose(k), ray, point.inverse_depth);
    if (!projection) continue;
    const Eigen::Vector2d& d = projection->J_inverse_depth;
    best = std::max(best, d.dot(tensor * d) / std::max(tensor.trace(), 1e-12));
  }
  return std::sqrt(best);
}

}  // namespace

bool setGeometricCovariances(Map& map, const PinholeCamera& camera) {
  std::vector<std::size_t> corners;
  for (std::size_t i = 0; i < map.corners; ++i) corners.push_back(i);
  Equations equations(map, camera, corners);
  const LinearSystem<double>& system = equations.system;
  std::vector<double> across;
  for (const Observation& seen : map.observations) {
    const MapPoint& corner = map.points[seen.corner];
    const Eigen::Vector3d ray = camera.unproject(corner.pixel.cast<double>());
    const auto projection = projectHosted(camera, map.pose(seen.frame), ray, corner.inverse_depth);
    if (!projection) continue;
    const Eigen::Vector2d error = projection->pixel - seen.pixel;
    const Eigen::Vector2d& line = projection->J_inverse_depth;
    const Eigen::Vector2d weight =
        Eigen::Vector2d::Constant(huberWeight(error.norm(), kCornerHuber));
    equations.add<2>(seen.frame - 1, seen.corner, projection->J_pose, line, error, weight);
    const double length = line.norm();
    if (!(length > 0)) continue;
    across.push_back(std::abs(line.x() * error.y() - line.y() * error.x()) / length);
  }
  const Marginals marginals = equations.marginals();
  const double redundancy =
      equations.rows - static_cast<double>(system.size()) - static_cast<double>(map.corners) + 1;
  const double factor = equations.weighted_square / redundancy;
  const bool known = std::all_of(
      corners.begin(), corners.end(), [&](std::size_t corner) { return system.known(corner); });
  if (!known || !marginals.usable() || !(redundancy > 0)) return false;
  const Eigen::MatrixXd formal = std::sqrt(factor) * marginals.roots();
  const Eigen::MatrixXd clustered =
      std::sqrt(1 + kTailVarianceFactor * tailExcess(across)) * equations.clusteredRoots(marginals);
  Eigen::MatrixXd roots(system.size(), formal.cols() + clustered.cols());
  roots << formal, clustered;
  // Errors of one track in all frames are one error.
  const double own = factor * static_cast<double>(map.frames.size() - 1);
  const Eigen::MatrixXd in_gauge = marginals.inGauge(roots);
  const Eigen::VectorXd scale = equations.scale();
  setPoseCovariances(
      in_gauge * in_gauge.transpose() + own * marginals.depthVariance() * scale * scale.transpose(),
      map);
  Eigen::VectorXd effect(system.size());
  for (const std::size_t i : corners) {
    const double inverse_depth = equations.inverse_depth[i];
    marginals.depthEffect(system, i, inverse_depth, effect);
    map.points[i].variance = own * marginals.ownVariance(system, i, inverse_depth) +
                             (roots.transpose() * effect).squaredNorm();
  }
  return true;
}

bool setPhotometricCovariances(Map& map, const PinholeCamera& camera) {
  const PhotometricProblem problem(map, camera, 0);
  const std::size_t frames = map.frames.size() - 1;
  const std::size_t count = problem.patches.size();
  Equations equations(map, camera, problem.points);
  std::vector<double> energy(count, 0);
  std::vector<std::vector<char>> seen(count, std::vector<char>(frames, 0));
  for (std::size_t k = 0; k < frames; ++k) {
    const std::vector<PatchResidual> residuals = residualsOf(problem, map, k + 1);
    for (std::size_t i = 0; i < count; ++i) {
      const PatchResidual& r = residuals[i];
      if (!r.inside) continue;
      seen[i][k] = 1;
      const PatchVector weight = r.value.unaryExpr(
          [](double v) { return huberWeight(v, static_cast<double>(kHuberThreshold)); });
      equations.add<kPatternSize>(k, i, r.J_pose, r.J_inverse_depth, r.value, weight);
      energy[i] += (weight.array() * r.value.array().square() * (2 - weight.array())).sum();
    }
  }
  const LinearSystem<double>& system = equations.system;
  const Marginals marginals = equations.marginals();
  const double redundancy =
      equations.rows - static_cast<double>(count) - static_cast<double>(system.size());
  if (!marginals.usable() || !(redundancy > 0)) return false;
  double noise_variance = 0;
  for (const double value : energy) noise_variance += value / redundancy;
  const Eigen::MatrixXd roots = marginals.inGauge(equations.clusteredRoots(marginals));
  const Eigen::MatrixXd poses = kPoseVarianceFactor * roots * roots.transpose();
  setPoseCovariances(poses, map);
  Eigen::VectorXd effect(system.size());
  for (std::size_t i = 0; i < count; ++i) {
    MapPoint& point = map.points[problem.points[i]];
    const double speed = speedOf(map, camera, point, seen[i]);
    if (!system.known(i) || !(speed > 0)) continue;
    const auto views = static_cast<double>(std::count(seen[i].begin(), seen[i].end(), char{1}));
    const double own = std::max(noise_variance, energy[i] / (kPatternSize * views - 1));
    marginals.depthEffect(system, i, point.inverse_depth, effect);
    point.variance = own / system.depth_hessian[i] + effect.dot(poses * effect) +
                     std::pow(kMatchError / speed, 2) +
                     std::pow(kSlantError * point.inverse_depth, 2);
  }
  return true;
}

}  // namespace dsorb::published
