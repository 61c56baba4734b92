// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/bundle/reprojection_equations.h"

#include "base/parallel.h"
#include "estimate/levenberg_marquardt.h"
#include "estimate/robust_loss.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>

namespace dsorb::init_orb {
namespace {

constexpr Eigen::Index kPoseSize = 6;

/// Estimate beside what is known.
struct Comparison {
  SE3 T_to_from;  // estimated
  Vector6d error = Vector6d::Zero();
};

std::vector<Comparison> compare(const std::vector<KnownMotion>& motions,
                                const std::vector<SE3>& T_cam_ref) {
  std::vector<Comparison> all;
  for (const KnownMotion& known : motions) {
    const SE3 from = known.from == KnownMotion::kReference ? SE3() : T_cam_ref[known.from];
    Comparison one{T_cam_ref[known.to] * from.inverse(), Vector6d::Zero()};
    one.error.tail<3>() =
        so3Log(one.T_to_from.unitQuaternion() * known.T_to_from.unitQuaternion().conjugate());
    all.push_back(one);
  }
  return all;
}

/// Metres of a unit with the least cost, at least 0, and its information; completes the errors.
double fitMetres(const std::vector<KnownMotion>& motions,
                 std::vector<Comparison>& all,
                 double& information) {
  double product = 0;
  information = 0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const Eigen::Matrix<double, 3, 6> of_translation = motions[i].information.topRows<3>();
    const Eigen::Vector3d t = all[i].T_to_from.translation();
    Vector6d rest = all[i].error;
    rest.head<3>() -= motions[i].T_to_from.translation();
    product -= t.dot(of_translation * rest);
    information += t.dot(of_translation.leftCols<3>() * t);
  }
  const double metres = information > 0 ? std::max(0., product / information) : 0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (!motions[i].has_translation) continue;
    all[i].error.head<3>() =
        metres * all[i].T_to_from.translation() - motions[i].T_to_from.translation();
  }
  return metres;
}

}  // namespace

MotionEquations motionEquations(const std::vector<KnownMotion>& motions,
                                const std::vector<SE3>& T_cam_ref) {
  const auto size = static_cast<Eigen::Index>(T_cam_ref.size()) * kPoseSize;
  MotionEquations made;
  made.H = Eigen::MatrixXd::Zero(size, size);
  made.b = Eigen::VectorXd::Zero(size);
  std::vector<Comparison> all = compare(motions, T_cam_ref);
  double information = 0;
  made.metres = fitMetres(motions, all, information);
  Eigen::VectorXd of_metres = Eigen::VectorXd::Zero(size);
  for (std::size_t i = 0; i < all.size(); ++i) {
    const KnownMotion& known = motions[i];
    const Eigen::Vector3d t = all[i].T_to_from.translation();
    const Eigen::Matrix3d R = all[i].T_to_from.rotationMatrix();
    Eigen::MatrixXd J = Eigen::MatrixXd::Zero(kPoseSize, size);
    const auto to = static_cast<Eigen::Index>(known.to) * kPoseSize;
    J.block<3, 3>(0, to) = made.metres * Eigen::Matrix3d::Identity();
    J.block<3, 3>(0, to + 3) = -made.metres * hat(t);
    J.block<3, 3>(3, to + 3).setIdentity();
    if (known.from != KnownMotion::kReference) {
      const auto from = static_cast<Eigen::Index>(known.from) * kPoseSize;
      J.block<3, 3>(0, from) = -made.metres * R;
      J.block<3, 3>(3, from + 3) = -R;
    }
    const Eigen::MatrixXd weighted = J.transpose() * known.information;
    made.H += weighted * J;
    made.b += weighted * all[i].error;
    of_metres += weighted.leftCols<3>() * t;
    made.cost += 0.5 * all[i].error.dot(known.information * all[i].error);
    made.rows += known.has_translation ? 6 : 3;
  }
  if (information > 0) --made.rows;
  if (made.metres > 0) made.H -= of_metres * of_metres.transpose() / information;
  return made;
}

std::optional<HostedProjection> projectCorner(const InitialMap& map,
                                              const PinholeCamera& camera,
                                              const CornerObservation& observation) {
  const Corner& corner = map.corners[observation.corner];
  return projectHosted(camera,
                       *map.frames[observation.frame].T_cam_ref,
                       camera.unproject(corner.pixel),
                       corner.inverse_depth);
}

double robustCost(double error, const GeometricOptions& options) {
  const double limit = options.loss_threshold;
  const double weight = robustWeight(error, options);
  if (options.loss == RobustLoss::kCauchy) return -0.5 * limit * limit * std::log(weight);
  double energy = 0;
  huberEnergies(error, weight, energy);
  return 0.5 * energy;
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

void ReprojectionState::moveFrom(const ReprojectionState& from, const DampedSolver& solution) {
  for (std::size_t f = 0; f < from.T_cam_ref.size(); ++f) {
    const auto at = static_cast<Eigen::Index>(f) * kPoseSize;
    T_cam_ref[f] = SE3::exp(solution.step().segment<kPoseSize>(at)) * from.T_cam_ref[f];
  }
  for (std::size_t i = 0; i < from.inverse_depth.size(); ++i) {
    inverse_depth[i] = from.inverse_depth[i] + solution.depthStep()[i];
  }
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

KnownTerms::KnownTerms(const InitialMap& map, const PoseRows& rows) {
  if (map.scaleKnown()) {
    for (const Corner& corner : map.corners) depths_.push_back(corner.known);
  }
  for (KnownMotion known : map.known_motions) {
    const int to = rows.first[known.to];
    if (to < 0 || (known.from != 0 && rows.first[known.from] < 0)) continue;
    known.to = static_cast<std::size_t>(to / kPoseSize);
    known.from = known.from == 0 ? KnownMotion::kReference
                                 : static_cast<std::size_t>(rows.first[known.from] / kPoseSize);
    motions_.push_back(known);
  }
}

void KnownTerms::addTo(ReprojectionEquations& equations, const ReprojectionState& state) const {
  for (std::size_t i = 0; i < depths_.size(); ++i) {
    if (!depths_[i]) continue;
    const KnownTerm term = knownTerm(depths_[i], state.inverse_depth[i]);
    equations.system.depth_hessian[i] += term.hessian;
    equations.system.depth_gradient[i] += term.gradient;
    equations.cost += term.cost;
    equations.weighted_square += term.weighted_square;
    ++equations.rows;
  }
  if (motions_.empty()) return;
  const MotionEquations made = motionEquations(motions_, state.T_cam_ref);
  equations.system.H.topLeftCorner(made.H.rows(), made.H.cols()) += made.H;
  equations.system.b.head(made.b.size()) += made.b;
  equations.cost += made.cost;
  equations.weighted_square += 2 * made.cost;
  equations.rows += made.rows;
}

ReprojectionProblem::ReprojectionProblem(const InitialMap& map,
                                         const PoseRows& rows,
                                         const PinholeCamera& camera,
                                         const GeometricOptions& options)
    : camera_(camera),
      loss_{options.loss, options.loss_threshold},
      ray_x_(wholeLanes(map.corners.size()), 0.0),
      ray_y_(ray_x_.size(), 0.0),
      known_(map, rows) {
  for (std::size_t i = 0; i < map.corners.size(); ++i) {
    const Eigen::Vector3d ray = camera.unproject(map.corners[i].pixel);
    ray_x_[i] = ray.x();
    ray_y_[i] = ray.y();
  }
  const std::vector<double> zeros(stride(), 0.0);
  observations_.assign(static_cast<std::size_t>(rows.size / kPoseSize),
                       {zeros, zeros, zeros, zeros, zeros});
  const double weight = 1 / (options.sigma * options.sigma);
  for (const CornerObservation& observation : map.observations) {
    const int row = rows.first[observation.frame];
    const std::size_t corner = observation.corner;
    if (row < 0) continue;
    FrameObservations& seen = observations_[static_cast<std::size_t>(row / kPoseSize)];
    const Eigen::Matrix2d& whitening = observation.whitening;
    seen.pixel_x[corner] = observation.pixel.x();
    seen.pixel_y[corner] = observation.pixel.y();
    seen.information_xx[corner] = weight * whitening.col(0).squaredNorm();
    seen.information_xy[corner] = weight * whitening.col(0).dot(whitening.col(1));
    seen.information_yy[corner] = weight * whitening.col(1).squaredNorm();
  }
}

ObservationRun ReprojectionProblem::run(std::size_t frame,
                                        std::size_t first,
                                        std::size_t count,
                                        const ReprojectionState& state) const {
  const FrameObservations& seen = observations_[frame];
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
        linearizeObservations(frame[f],
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
    system.H.block<kPoseSize, kPoseSize>(at, at) = pose.hessian;
    system.b.segment<kPoseSize>(at) = pose.gradient;
    total += pose;
  }
  equations.cost = total.behind > 0 ? std::numeric_limits<double>::infinity() : total.cost;
  equations.weighted_square = total.weighted_square;
  equations.rows = 2 * static_cast<int>(total.observations);
  known_.addTo(equations, state);
}

ReprojectionEquations linearize(const InitialMap& map,
                                const PoseRows& pose_rows,
                                const PinholeCamera& camera,
                                const GeometricOptions& options) {
  ReprojectionEquations equations;
  ReprojectionProblem(map, pose_rows, camera, options)
      .linearize(ReprojectionState(map, pose_rows), equations);
  return equations;
}

std::optional<double> reprojectionCost(const InitialMap& map,
                                       const PinholeCamera& camera,
                                       const GeometricOptions& options) {
  const double cost = linearize(map, PoseRows(map), camera, options).cost;
  return std::isfinite(cost) ? std::optional(cost) : std::nullopt;
}

std::optional<int> solveReprojections(InitialMap& map,
                                      const PinholeCamera& camera,
                                      const GeometricOptions& options,
                                      const Stopping& stopping) {
  const PoseRows pose_rows(map);
  if (pose_rows.size == 0) return std::nullopt;
  const ReprojectionProblem problem(map, pose_rows, camera, options);
  SchurProblem<const ReprojectionProblem&, ReprojectionState, ReprojectionEquations> adjustment(
      problem, ReprojectionState(map, pose_rows), stopping);
  const std::optional<int> iterations = minimize(adjustment, stopping);
  if (!iterations) return std::nullopt;
  adjustment.state().writeTo(map, pose_rows);
  return iterations;
}

}  // namespace dsorb::init_orb
