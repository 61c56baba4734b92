// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/bundle/reprojection_equations.h"

#include "base/parallel.h"
#include "base/target_clones.h"
#include "estimate/robust_loss.h"
#include "estimate/triangle_sums.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>

namespace dsorb::init_orb {
namespace {

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

namespace {

constexpr std::size_t kCornerBlock = 64;  // corners that one thread takes at a time
constexpr int kPairs = kFactors * (kFactors + 1) / 2;

/// Entries of a triangle of sums by the six of a pose, filled up to whole lanes.
constexpr std::size_t kTriangle = (triangleSums(kPoseSize) + 3) / 4 * 4;

/// Left increment of a pose by a motion until a row's time.
Vector6d until(double time, const Motion& motion) {
  return time * (motion.head<6>() + 0.5 * time * motion.tail<6>());
}

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

  void add(const MotionFactors& factors, double weight, const WhitenedError& error) {
    std::array<double, kTriangle> triangle{};
    for (int i = 0; i < 2; ++i) {
      const Vector6d row = error.J_pose.row(i).transpose();
      addToTriangle<kPoseSize>(row.data(), weight, error.value[i], triangle.data());
    }
    std::array<double, kPairs> pairs{};
    std::size_t pair = 0;
    for (int r = 0; r < kFactors; ++r) {
      for (int c = r; c < kFactors; ++c) pairs[pair++] = factors[r] * factors[c];
    }
    addByPairs(pairs.data(), triangle.data(), triangles.data());
    ++observations;
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

/// What the caller knows of the inverse depths and of the motions between posed frames.
class KnownTerms {
 public:
  KnownTerms(const InitialMap& map, const UnknownRows& rows) {
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

  /// @param equations whose first unknowns are the poses
  void addTo(ReprojectionEquations& equations, const ReprojectionState& state) const {
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

 private:
  std::vector<KnownInverseDepth> depths_;  // by corner; empty: none
  std::vector<KnownMotion> motions_;       // frames are indices of posed ones
};

/// Observations of corners that were all exposed at one time, arranged for the kernels.
class LaneObservations {
 public:
  LaneObservations(const InitialMap& map,
                   const UnknownRows& rows,
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
    const std::vector<double> zeros(ray_x_.size(), 0.0);
    frames_.assign(static_cast<std::size_t>(rows.frames()), {zeros, zeros, zeros, zeros, zeros});
    const double weight = 1 / (options.sigma * options.sigma);
    for (const CornerObservation& observation : map.observations) {
      const int row = rows.first[observation.frame];
      const std::size_t corner = observation.corner;
      if (row < 0) continue;
      FrameObservations& seen = frames_[static_cast<std::size_t>(row / kPoseSize)];
      const Eigen::Matrix2d& whitening = observation.whitening;
      seen.pixel_x[corner] = observation.pixel.x();
      seen.pixel_y[corner] = observation.pixel.y();
      seen.information_xx[corner] = weight * whitening.col(0).squaredNorm();
      seen.information_xy[corner] = weight * whitening.col(0).dot(whitening.col(1));
      seen.information_yy[corner] = weight * whitening.col(1).squaredNorm();
    }
  }

  void linearize(const ReprojectionState& state, ReprojectionEquations& equations) const;

 private:
  struct FrameObservations {
    std::vector<double> pixel_x, pixel_y, information_xx, information_xy, information_yy;
  };

  PinholeCamera camera_;
  LossSetting loss_;
  std::vector<double> ray_x_;
  std::vector<double> ray_y_;
  std::vector<FrameObservations> frames_;  // by posed frame
};

void LaneObservations::linearize(const ReprojectionState& state,
                                 ReprojectionEquations& equations) const {
  std::vector<Warp<double>> frame;
  for (const SE3& pose : state.T_cam_ref) frame.push_back(makeWarp<double>(camera_, pose));
  LinearSystem<double>& system = equations.system;
  const std::size_t frames = frames_.size();
  const std::size_t stride = ray_x_.size();
  system.reset(static_cast<Eigen::Index>(frames * kPoseSize), stride);
  const std::size_t blocks = (stride + kCornerBlock - 1) / kCornerBlock;
  std::vector<PoseSums> partial(blocks * frames);
  forEachRange(blocks, 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t block = begin; block < end; ++block) {
      const std::size_t first = block * kCornerBlock;
      const std::size_t count = std::min(kCornerBlock, stride - first);
      for (std::size_t f = 0; f < frames; ++f) {
        linearizeObservations(frame[f],
                              {ray_x_.data() + first,
                               ray_y_.data() + first,
                               state.inverse_depth.data() + first,
                               frames_[f].pixel_x.data() + first,
                               frames_[f].pixel_y.data() + first,
                               frames_[f].information_xx.data() + first,
                               frames_[f].information_xy.data() + first,
                               frames_[f].information_yy.data() + first,
                               count},
                              loss_,
                              system.sumsOf(first, f * kPoseSize),
                              partial[block * frames + f]);
      }
    }
  });
  PoseSums total;
  for (std::size_t f = 0; f < frames; ++f) {
    PoseSums pose;
    for (std::size_t block = 0; block < blocks; ++block) pose += partial[block * frames + f];
    const auto at = static_cast<Eigen::Index>(f * kPoseSize);
    system.H.block<kPoseSize, kPoseSize>(at, at) = pose.hessian;
    system.b.segment<kPoseSize>(at) = pose.gradient;
    total += pose;
  }
  equations.cost = total.behind > 0 ? std::numeric_limits<double>::infinity() : total.cost;
  equations.weighted_square = total.weighted_square;
  equations.rows = 2 * static_cast<int>(total.observations);
}

/// The adjustment of a map, for SchurProblem. Runs in parallel inside the caller's arena; sums are
/// added in an order that does not depend on it.
class ReprojectionProblem {
 public:
  ReprojectionProblem(const InitialMap& map,
                      const UnknownRows& rows,
                      const PinholeCamera& camera,
                      const GeometricOptions& options)
      : map_(map),
        rows_(rows),
        camera_(camera),
        options_(options),
        times_(map, camera),
        known_(map, rows),
        first_(map.corners.size() + 1, 0) {
    for (const CornerObservation& observation : map.observations) ++first_[observation.corner + 1];
    for (std::size_t i = 1; i < first_.size(); ++i) first_[i] += first_[i - 1];
    if (!rows.rolling) lanes_.emplace(map, rows, camera, options);
  }

  void linearize(const ReprojectionState& state, ReprojectionEquations& equations) const;
  void move(const ReprojectionState& from,
            const DampedSolver& solution,
            ReprojectionState& to) const;
  void writeTo(InitialMap& map, const ReprojectionState& state) const;

 private:
  void linearizeRolling(const ReprojectionState& state, ReprojectionEquations& equations) const;
  void addCorner(std::size_t corner,
                 const ReprojectionState& state,
                 const std::vector<Matrix6d>& adjoints,
                 LinearSystem<double>& system,
                 FrameSums* sums) const;
  /// What is known of the motions.
  void addPriors(const ReprojectionState& state, ReprojectionEquations& equations) const;

  const InitialMap& map_;
  const UnknownRows& rows_;
  const PinholeCamera& camera_;
  const GeometricOptions& options_;
  RowTimesOfMap times_;
  std::optional<LaneObservations> lanes_;  // where no rows move
  KnownTerms known_;
  std::vector<std::size_t> first_;  // observation of each corner
};

void ReprojectionProblem::addCorner(std::size_t corner,
                                    const ReprojectionState& state,
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
    const int row = rows_.first[observation.frame];
    if (row < 0) continue;
    const auto frame = static_cast<std::size_t>(row / kPoseSize);
    FrameSums& sum = sums[frame];
    const Vector6d moved =
        until(times_.target[i], state.motion_change[frame]) - adjoints[frame] * of_host;
    const auto projection = projectHosted(
        camera_, SE3::exp(moved) * state.T_cam_ref[frame], ray, state.inverse_depth[corner]);
    if (!projection) {
      sum.cost = std::numeric_limits<double>::infinity();
      continue;
    }
    const WhitenedError error(observation, *projection, options_.sigma);
    const double norm = error.value.norm();
    const double weight = robustWeight(norm, options_);
    const MotionFactors factors = times_.factors(i, corner);
    sum.add(factors, weight, error);
    sum.cost += robustCost(norm, options_);
    sum.weighted_square += weight * norm * norm;
    rows_.addByFactors(
        weight * error.J_pose.transpose() * error.J_depth, row, factors, adjoints[frame], coupling);
    system.depth_hessian[corner] += weight * error.J_depth.squaredNorm();
    system.depth_gradient[corner] += weight * error.J_depth.dot(error.value);
  }
}

void ReprojectionProblem::addPriors(const ReprojectionState& state,
                                    ReprojectionEquations& equations) const {
  for (std::size_t k = 0; k < map_.motions.size(); ++k) {
    const std::optional<std::size_t> index = rows_.motionIndex(k);
    if (!index) continue;
    const int at = rows_.motion(static_cast<int>(*index) * kPoseSize);
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

void ReprojectionProblem::linearize(const ReprojectionState& state,
                                    ReprojectionEquations& equations) const {
  if (lanes_) {
    lanes_->linearize(state, equations);
  } else {
    linearizeRolling(state, equations);
  }
  known_.addTo(equations, state);
}

void ReprojectionProblem::linearizeRolling(const ReprojectionState& state,
                                           ReprojectionEquations& equations) const {
  LinearSystem<double>& system = equations.system;
  const std::size_t corners = map_.corners.size();
  system.reset(rows_.size(), state.inverse_depth.size());
  std::vector<Matrix6d> adjoints;
  for (const SE3& pose : state.T_cam_ref) adjoints.push_back(pose.adjoint());
  const std::size_t frames = adjoints.size();
  const std::size_t blocks = (corners + kCornerBlock - 1) / kCornerBlock;
  std::vector<FrameSums> partial(blocks * frames);
  forEachRange(blocks, 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin * kCornerBlock; i < std::min(corners, end * kCornerBlock); ++i) {
      addCorner(i, state, adjoints, system, partial.data() + i / kCornerBlock * frames);
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
}

void ReprojectionProblem::move(const ReprojectionState& from,
                               const DampedSolver& solution,
                               ReprojectionState& to) const {
  const Eigen::VectorXd& step = solution.step();
  for (std::size_t f = 0; f < from.T_cam_ref.size(); ++f) {
    const auto at = static_cast<Eigen::Index>(f) * kPoseSize;
    to.T_cam_ref[f] = SE3::exp(step.segment<kPoseSize>(at)) * from.T_cam_ref[f];
  }
  for (std::size_t i = 0; i < from.inverse_depth.size(); ++i) {
    to.inverse_depth[i] = from.inverse_depth[i] + solution.depthStep()[i];
  }
  for (std::size_t f = 0; f < from.motion_change.size(); ++f) {
    const int at = rows_.motion(static_cast<int>(f) * kPoseSize);
    to.motion_change[f] = from.motion_change[f] + step.segment<kMotionSize>(at);
  }
}

void ReprojectionProblem::writeTo(InitialMap& map, const ReprojectionState& state) const {
  const bool rolling = !state.motion_change.empty();
  for (std::size_t i = 0; rolling && i < map.observations.size(); ++i) {
    CornerObservation& observation = map.observations[i];
    if (rows_.first[observation.frame] < 0) continue;
    const auto projection = projectCorner(map, camera_, observation);
    if (!projection) continue;
    const Motion& change = state.motion_change[*rows_.motionIndex(observation.frame)];
    observation.pixel -= projection->J_pose * until(times_.target[i], change);
  }
  for (std::size_t k = 0; k < map.motions.size(); ++k) {
    const std::optional<std::size_t> index = rows_.motionIndex(k);
    if (!index) continue;
    map.motions[k].found.velocity += state.motion_change[*index].head<6>();
    map.motions[k].found.acceleration += state.motion_change[*index].tail<6>();
  }
  auto pose = state.T_cam_ref.begin();
  for (std::size_t k = 0; k < rows_.first.size(); ++k) {
    if (rows_.first[k] >= 0) map.frames[k].T_cam_ref = *pose++;
  }
  for (std::size_t i = 0; i < map.corners.size(); ++i) {
    map.corners[i].inverse_depth = state.inverse_depth[i];
  }
  placeCorners(map, camera_);
}

}  // namespace

UnknownRows::UnknownRows(const InitialMap& map)
    : first(map.frames.size(), -1), rolling(!map.motions.empty()) {
  for (std::size_t k = 1; k < map.frames.size(); ++k) {
    if (map.frames[k].T_cam_ref) {
      first[k] = poses;
      poses += kPoseSize;
    }
  }
}

void UnknownRows::addByFactors(const Vector6d& by_pose,
                               int pose_row,
                               const MotionFactors& of_observation,
                               const Matrix6d& adjoint,
                               Eigen::Ref<Eigen::VectorXd> all) const {
  all.segment<kPoseSize>(pose_row) += by_pose;
  if (!rolling) return;
  const std::array<int, kFactors> rows = ofFactors(pose_row);
  const Vector6d of_reference = adjoint.transpose() * by_pose;
  for (int k = 1; k < kFactors; ++k) {
    all.segment<kPoseSize>(rows[static_cast<std::size_t>(k)]) +=
        of_observation[k] * (k < 3 ? by_pose : of_reference);
  }
}

Eigen::VectorXd UnknownRows::scaleDirection(const InitialMap& map) const {
  Eigen::VectorXd direction = Eigen::VectorXd::Zero(size());
  for (std::size_t k = 1; k < first.size(); ++k) {
    if (first[k] >= 0) direction.segment<3>(first[k]) = map.frames[k].T_cam_ref->translation();
  }
  for (std::size_t k = 0; k < map.motions.size(); ++k) {
    const std::optional<std::size_t> index = motionIndex(k);
    if (!index) continue;
    const int at = motion(static_cast<int>(*index) * kPoseSize);
    direction.segment<3>(at) = map.motions[k].found.velocity.head<3>();
    direction.segment<3>(at + kPoseSize) = map.motions[k].found.acceleration.head<3>();
  }
  return direction;
}

RowTimesOfMap::RowTimesOfMap(const InitialMap& map, const PinholeCamera& camera)
    : host(map.corners.size()), target(map.observations.size()) {
  if (map.motions.empty()) return;
  const auto time_at = [](const RollingShutter& shutter, const Eigen::Vector2f& pixel) {
    return static_cast<double>(rowTime(shutter, pixel.x(), pixel.y()));
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

ReprojectionState::ReprojectionState(const InitialMap& map, const UnknownRows& rows)
    : inverse_depth(wholeLanes(map.corners.size()), 0.0) {
  for (std::size_t k = 0; k < rows.first.size(); ++k) {
    if (rows.first[k] >= 0) T_cam_ref.push_back(*map.frames[k].T_cam_ref);
  }
  std::transform(
      map.corners.begin(), map.corners.end(), inverse_depth.begin(), [](const Corner& corner) {
        return corner.inverse_depth;
      });
  if (!map.motions.empty()) motion_change.assign(T_cam_ref.size() + 1, Motion::Zero());
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

std::optional<WhitenedError> errorOf(const InitialMap& map,
                                     const PinholeCamera& camera,
                                     const CornerObservation& observation,
                                     double sigma) {
  const auto projection = projectCorner(map, camera, observation);
  if (!projection) return std::nullopt;
  return WhitenedError(observation, *projection, sigma);
}

double robustCost(double error, const GeometricOptions& options) {
  const double limit = options.loss_threshold;
  const double weight = robustWeight(error, options);
  if (options.loss == RobustLoss::kCauchy) return -0.5 * limit * limit * std::log(weight);
  return 0.5 * huberEnergies(error, weight);
}

double robustWeight(double error, const GeometricOptions& options) {
  if (options.loss == RobustLoss::kHuber) return huberWeight(error, options.loss_threshold);
  return 1 / cauchyRatio(error * error, options.loss_threshold);
}

ReprojectionEquations linearize(const InitialMap& map,
                                const UnknownRows& rows,
                                const PinholeCamera& camera,
                                const GeometricOptions& options) {
  ReprojectionEquations equations;
  ReprojectionProblem(map, rows, camera, options)
      .linearize(ReprojectionState(map, rows), equations);
  return equations;
}

std::optional<double> reprojectionCost(const InitialMap& map,
                                       const PinholeCamera& camera,
                                       const GeometricOptions& options) {
  UnknownRows rows(map);
  rows.rolling = false;  // pixels are where the middle rows see them: motions have no part
  const double cost = linearize(map, rows, camera, options).cost;
  return std::isfinite(cost) ? std::optional(cost) : std::nullopt;
}

std::optional<int> solveGeometry(InitialMap& map,
                                 const PinholeCamera& camera,
                                 const GeometricOptions& options,
                                 const Stopping& stopping) {
  const UnknownRows rows(map);
  if (rows.poses == 0) return std::nullopt;
  const ReprojectionProblem problem(map, rows, camera, options);
  SchurProblem<const ReprojectionProblem&, ReprojectionState, ReprojectionEquations> adjustment(
      problem, ReprojectionState(map, rows), stopping);
  const std::optional<int> iterations = minimize(adjustment, stopping);
  if (!iterations) return std::nullopt;
  problem.writeTo(map, adjustment.state());
  return iterations;
}

}  // namespace dsorb::init_orb
