// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/recent_motion.h"

#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace dsorb {
namespace {

constexpr std::size_t kRecent = 3;
// A hand's, where the sequence has not shown its own yet; counts as one frame. Inverse depths are
// about 1, and a hand turns as fast as it moves. [rad/s, unit/s]
constexpr double kFirstSigma = 0.05;
constexpr double kLeastSigma = 1e-4;  // as well as a velocity may be known
constexpr double kMemory = 0.9;       // share of the sums that a new frame leaves: ten frames count

/// Derivative of the logarithm of a motion by the time, to first order in it.
/// @param velocity from the left
Vector6d logVelocity(const Vector6d& log, const Vector6d& velocity) {
  const Eigen::Vector3d t = log.head<3>();
  const Eigen::Vector3d r = log.tail<3>();
  const Eigen::Vector3d v = velocity.head<3>();
  const Eigen::Vector3d w = velocity.tail<3>();
  Vector6d bracket;
  bracket << r.cross(v) + t.cross(w), r.cross(w);
  return velocity - 0.5 * bracket;
}

}  // namespace

RowMotion motionBetween(const TimedPose& pose, const Passage& before, const Passage& after) {
  const SE3 T_world_cam = pose.T_cam_world.inverse();
  Eigen::Matrix4d powers;
  Eigen::Matrix<double, 4, 6> values;
  Eigen::Index row = 0;
  for (const Passage* neighbour : {&before, &after}) {
    const double t = neighbour->pose.time - pose.time;
    const Vector6d moved = (neighbour->pose.T_cam_world * T_world_cam).log();
    powers.row(row) << t, t * t, t * t * t, t * t * t * t;
    values.row(row) = moved.transpose();
    powers.row(row + 1) << 1, 2 * t, 3 * t * t, 4 * t * t * t;
    values.row(row + 1) = logVelocity(moved, *neighbour->velocity).transpose();
    row += 2;
  }
  const Eigen::Matrix<double, 4, 6> factors = powers.partialPivLu().solve(values);
  return {factors.row(0).transpose(), 2 * factors.row(1).transpose()};
}

std::optional<Vector6d> RecentMotion::missed(const TimedPose& next) const {
  if (recent_.size() < kRecent || next.time == recent_.front().pose.time) return std::nullopt;
  const TimedPose& last = recent_.front().pose;
  const RowMotion motion = motionThrough(last, {recent_[1].pose, recent_[2].pose});
  const double time = next.time - last.time;
  const SE3 predicted =
      SE3::exp(time * motion.velocity + 0.5 * time * time * motion.acceleration) * last.T_cam_world;
  // A third of the jerk times the squared interval, where the jerk times the next expression is
  // the error of the pose.
  const double interval = (last.time - recent_[2].pose.time) / 2;
  const double of_jerk =
      time * (next.time - recent_[1].pose.time) * (next.time - recent_[2].pose.time) / 6;
  return (interval * interval / (3 * of_jerk)) * (next.T_cam_world * predicted.inverse()).log();
}

std::optional<double> RecentMotion::surprise(const TimedPose& next) const {
  const std::optional<Vector6d> missed = this->missed(next);
  if (!missed) return std::nullopt;
  const Vector6d normalised = missed->cwiseQuotient(sigma());
  return std::max(normalised.head<3>().norm(), normalised.tail<3>().norm()) / std::sqrt(3.0);
}

void RecentMotion::push(const Passage& newest) {
  if (const std::optional<Vector6d> missed = this->missed(newest.pose)) {
    translation_ = kMemory * translation_ + missed->head<3>().squaredNorm() / 3;
    rotation_ = kMemory * rotation_ + missed->tail<3>().squaredNorm() / 3;
    weight_ = kMemory * weight_ + 1;
  }
  recent_.insert(recent_.begin(), newest);
  if (recent_.size() > kRecent) recent_.pop_back();
}

void RecentMotion::changeReference(const SE3& T_new_old) {
  const SE3 T_old_new = T_new_old.inverse();
  for (Passage& passage : recent_) {
    passage.pose.T_cam_world = passage.pose.T_cam_world * T_old_new;
  }
}

std::vector<TimedPose> RecentMotion::poses() const {
  std::vector<TimedPose> poses;
  poses.reserve(recent_.size());
  for (const Passage& passage : recent_) poses.push_back(passage.pose);
  return poses;
}

Vector6d RecentMotion::sigma() const {
  // The first guess counts for less and less, as what has been seen first does.
  const double share = 1 - (1 - kMemory) * weight_;
  const auto deviation = [&](double sum) {
    const double variance = (share * kFirstSigma * kFirstSigma + sum) / (share + weight_);
    return std::max(kLeastSigma, std::sqrt(variance));
  };
  Vector6d sigma;
  sigma.head<3>().setConstant(deviation(translation_));
  sigma.tail<3>().setConstant(deviation(rotation_));
  return sigma;
}

MotionPrior RecentMotion::atEnd() const {
  std::vector<TimedPose> before = poses();
  before.erase(before.begin());
  return {motionThrough(recent_.front().pose, before), sigma()};
}

MotionPrior RecentMotion::inMiddle() const {
  const Vector6d half = 0.5 * sigma();
  const Passage& after = recent_.front();
  const Passage& before = recent_.back();
  const double time = recent_[1].pose.time;
  const bool apart =
      after.pose.time != time && before.pose.time != time && after.pose.time != before.pose.time;
  if (recent_.size() == kRecent && apart && after.velocity && before.velocity) {
    return {motionBetween(recent_[1].pose, before, after), half};
  }
  std::vector<TimedPose> around = poses();
  around.erase(around.begin() + 1);
  return {motionThrough(recent_[1].pose, around), half};
}

}  // namespace dsorb
