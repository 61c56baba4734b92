// SPDX-License-Identifier: BSD-3-Clause
#include "track/motion_guesses.h"

#include <algorithm>
#include <cmath>
#include <cstdlib>

namespace dsorb::track {
namespace {

constexpr double kSmallRotation = 0.02;  // vector part of a quaternion before it is normalised
constexpr double kRepeatedShare = 0.05;  // of a step; less is another image of the same moment
constexpr double kRepeatedFor = 2.5;     // intervals
constexpr double kMaxIntervals = 4;      // over which a velocity is extrapolated

/// Appends base * rotation for the rotations about exactly `axes` axes, all signs.
void appendSmallRotations(const SE3& base, int axes, std::vector<SE3>& guesses) {
  for (int x = -1; x <= 1; ++x) {
    for (int y = -1; y <= 1; ++y) {
      for (int z = -1; z <= 1; ++z) {
        if (std::abs(x) + std::abs(y) + std::abs(z) != axes) continue;
        const Eigen::Quaterniond rotation(
            1.0, x * kSmallRotation, y * kSmallRotation, z * kSmallRotation);
        guesses.push_back(base * SE3(rotation, Eigen::Vector3d::Zero()));
      }
    }
  }
}

/// Time since the previous frame over the interval before; 1 where times do not grow. Motion is not
/// constant for long.
double intervals(const TimedPose& previous, const TimedPose& before, double time) {
  const double ratio = (time - previous.time) / (previous.time - before.time);
  return std::isfinite(ratio) && ratio > 0 ? std::min(ratio, kMaxIntervals) : 1;
}

Vector6d stepBetween(const TimedPose& older, const TimedPose& newer) {
  return (newer.T_cam_world * older.T_cam_world.inverse()).log();
}

/// Whether a frame shows hardly anything of the motion that was expected; not for long, as then the
/// camera stands still.
bool repeats(const TimedPose& newest, const TimedPose& previous, const TimedPose& before) {
  const double waited = intervals(previous, before, newest.time);
  const double expected = waited * stepBetween(before, previous).norm();
  return waited < kRepeatedFor && stepBetween(previous, newest).norm() < kRepeatedShare * expected;
}

}  // namespace

void MotionHistory::push(const TimedPose& newest) {
  if (previous && before && repeats(newest, *previous, *before)) return;
  before = previous;
  previous = newest;
}

MotionHistory MotionHistory::relativeTo(const SE3& T_new_old) const {
  const SE3 T_old_new = T_new_old.inverse();
  MotionHistory moved = *this;
  for (std::optional<TimedPose>* timed : {&moved.previous, &moved.before}) {
    if (*timed) (*timed)->T_cam_world = (*timed)->T_cam_world * T_old_new;
  }
  return moved;
}

std::vector<SE3> motionGuesses(const MotionHistory& history, double time) {
  if (!history.previous) return {SE3()};
  const SE3& previous = history.previous->T_cam_world;
  constexpr std::size_t kAll = 31;
  std::vector<SE3> guesses;
  guesses.reserve(kAll);
  SE3 constant_motion = previous;
  if (history.before) {
    const Vector6d step = intervals(*history.previous, *history.before, time) *
                          stepBetween(*history.before, *history.previous);
    constant_motion = SE3::exp(step) * previous;
    guesses.push_back(constant_motion);
    guesses.push_back(SE3::exp(2 * step) * previous);
    guesses.push_back(SE3::exp(0.5 * step) * previous);
  }
  guesses.push_back(previous);
  guesses.emplace_back();
  for (int axes = 1; axes <= 3; ++axes) appendSmallRotations(constant_motion, axes, guesses);
  return guesses;
}

}  // namespace dsorb::track
