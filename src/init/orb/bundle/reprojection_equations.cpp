// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/bundle/reprojection_equations.h"

#include "base/parallel.h"
#include "estimate/robust_loss.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

namespace dsorb::init_orb {
namespace {

constexpr std::size_t kCornerBlock = 64;  // corners that one thread takes at a time

}  // namespace

std::optional<HostedProjection> projectCorner(const InitialMap& map,
                                              const PinholeCamera& camera,
                                              const Observation& observation) {
  const Corner& corner = map.corners[static_cast<std::size_t>(observation.corner)];
  return projectHosted(camera,
                       *map.frames[static_cast<std::size_t>(observation.frame)].T_cam_ref,
                       camera.unproject(corner.pixel),
                       corner.inverse_depth);
}

bool allKnown(const LinearSystem<double>& system, const InitialMap& map) {
  return std::all_of(system.depth_hessian.begin(),
                     system.depth_hessian.begin() + static_cast<std::ptrdiff_t>(map.corners.size()),
                     [](double h) { return h > 0; });
}

double robustCost(double error, const GeometricOptions& options) {
  const double limit = options.loss_threshold;
  const double weight = robustWeight(error, options);
  return options.loss == RobustLoss::kHuber ? 0.5 * weight * error * error * (2 - weight)
                                            : -0.5 * limit * limit * std::log(weight);
}

double robustWeight(double error, const GeometricOptions& options) {
  if (options.loss == RobustLoss::kHuber) return huberWeight(error, options.loss_threshold);
  double ratio = 1;
  double weight = 1;
  cauchyWeights(error * error, options.loss_threshold, ratio, weight);
  return weight;
}

PoseRows::PoseRows(const InitialMap& map) : first(map.frames.size(), -1) {
  for (std::size_t k = 1; k < map.frames.size(); ++k) {
    if (map.frames[k].T_cam_ref) {
      first[k] = size;
      size += kPoseSize;
    }
  }
}

PoseRows::PoseRows(const InitialMap& map, const std::vector<int>& frames)
    : first(map.frames.size(), -1) {
  for (const int frame : frames) {
    first[static_cast<std::size_t>(frame)] = size;
    size += kPoseSize;
  }
}

Eigen::VectorXd scaleDirection(const InitialMap& map, const PoseRows& rows) {
  Eigen::VectorXd direction = Eigen::VectorXd::Zero(rows.size);
  for (std::size_t k = 1; k < map.frames.size(); ++k) {
    if (rows.first[k] >= 0) {
      direction.segment<3>(rows.first[k]) = map.frames[k].T_cam_ref->translation();
    }
  }
  return direction;
}

ReprojectionState::ReprojectionState(const InitialMap& map, const PoseRows& rows)
    : inverse_depth(wholeLanes(map.corners.size()), 0.0) {
  for (std::size_t k = 0; k < rows.first.size(); ++k) {
    if (rows.first[k] >= 0) T_cam_ref.push_back(*map.frames[k].T_cam_ref);
  }
  std::transform(
      map.corners.begin(), map.corners.end(), inverse_depth.begin(), [](const Corner& corner) {
        return corner.inverse_depth;
      });
}

void ReprojectionState::writeTo(InitialMap& map, const PoseRows& rows) const {
  auto pose = T_cam_ref.begin();
  for (std::size_t k = 0; k < rows.first.size(); ++k) {
    if (rows.first[k] >= 0) map.frames[k].T_cam_ref = *pose++;
  }
  for (std::size_t i = 0; i < map.corners.size(); ++i) {
    map.corners[i].inverse_depth = inverse_depth[i];
  }
}

ReprojectionProblem::ReprojectionProblem(const InitialMap& map,
                                         const std::vector<char>& kept,
                                         const PoseRows& rows,
                                         const PinholeCamera& camera,
                                         const GeometricOptions& options)
    : camera_(camera),
      loss_{options.loss, options.loss_threshold},
      ray_x_(wholeLanes(map.corners.size()), 0.0),
      ray_y_(ray_x_.size(), 0.0) {
  for (std::size_t i = 0; i < map.corners.size(); ++i) {
    const Eigen::Vector3d ray = camera.unproject(map.corners[i].pixel);
    ray_x_[i] = ray.x();
    ray_y_[i] = ray.y();
  }
  const std::vector<double> zeros(stride(), 0.0);
  sightings_.assign(static_cast<std::size_t>(rows.size / kPoseSize),
                    {zeros, zeros, zeros, zeros, zeros});
  const double weight = 1 / (options.sigma * options.sigma);
  for (const Observation& observation : map.observations) {
    const int row = rows.first[static_cast<std::size_t>(observation.frame)];
    const auto corner = static_cast<std::size_t>(observation.corner);
    if (row < 0 || (!kept.empty() && kept[corner] == 0)) continue;
    Sightings& seen = sightings_[static_cast<std::size_t>(row / kPoseSize)];
    const Eigen::Matrix2d& whitening = observation.whitening;
    seen.pixel_x[corner] = observation.pixel.x();
    seen.pixel_y[corner] = observation.pixel.y();
    seen.information_xx[corner] = weight * whitening.col(0).squaredNorm();
    seen.information_xy[corner] = weight * whitening.col(0).dot(whitening.col(1));
    seen.information_yy[corner] = weight * whitening.col(1).squaredNorm();
  }
}

SightingRun ReprojectionProblem::run(std::size_t frame,
                                     std::size_t first,
                                     std::size_t count,
                                     const ReprojectionState& state) const {
  const Sightings& seen = sightings_[frame];
  return {ray_x_.data() + first,
          ray_y_.data() + first,
          state.inverse_depth.data() + first,
          seen.pixel_x.data() + first,
          seen.pixel_y.data() + first,
          seen.information_xx.data() + first,
          seen.information_xy.data() + first,
          seen.information_yy.data() + first,
          count};
}

void ReprojectionProblem::linearize(const ReprojectionState& state,
                                    ReprojectionEquations& equations) const {
  std::vector<Warp<double>> frame;
  for (const SE3& pose : state.T_cam_ref) frame.push_back(makeWarp<double>(camera_, pose));
  LinearSystem<double>& system = equations.system;
  system.reset(static_cast<Eigen::Index>(frames() * kPoseSize), stride());
  const std::size_t blocks = (stride() + kCornerBlock - 1) / kCornerBlock;
  std::vector<PoseSums> partial(blocks * frames());
  forEachRange(blocks, 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t block = begin; block < end; ++block) {
      const std::size_t first = block * kCornerBlock;
      const std::size_t count = std::min(kCornerBlock, stride() - first);
      for (std::size_t f = 0; f < frames(); ++f) {
        linearizeSightings(frame[f],
                           run(f, first, count, state),
                           loss_,
                           system.sumsOf(first, f * kPoseSize),
                           partial[block * frames() + f]);
      }
    }
  });
  PoseSums total;
  for (std::size_t f = 0; f < frames(); ++f) {
    PoseSums pose;
    for (std::size_t block = 0; block < blocks; ++block) pose += partial[block * frames() + f];
    const auto at = static_cast<Eigen::Index>(f * kPoseSize);
    system.H.block<kPoseSize, kPoseSize>(at, at) = hessianOf(pose);
    system.b.segment<kPoseSize>(at) = Eigen::Map<const Vector6d>(pose.gradient.data());
    total += pose;
  }
  equations.cost = total.behind > 0 ? std::numeric_limits<double>::infinity() : total.cost;
  equations.weighted_square = total.weighted_square;
  equations.rows = 2 * static_cast<int>(total.sightings);
}

ReprojectionEquations linearize(const InitialMap& map,
                                const std::vector<char>& kept,
                                const PoseRows& pose_rows,
                                const PinholeCamera& camera,
                                const GeometricOptions& options) {
  ReprojectionEquations equations;
  ReprojectionProblem(map, kept, pose_rows, camera, options)
      .linearize(ReprojectionState(map, pose_rows), equations);
  return equations;
}

std::optional<double> reprojectionCost(const InitialMap& map,
                                       const std::vector<char>& kept,
                                       const PinholeCamera& camera,
                                       const GeometricOptions& options) {
  const double cost = linearize(map, kept, PoseRows(map), camera, options).cost;
  return std::isfinite(cost) ? std::optional(cost) : std::nullopt;
}

}  // namespace dsorb::init_orb
