// SPDX-License-Identifier: BSD-3-Clause
#include "track/motion_guesses.h"

#include <cstdlib>

namespace dsorb::track {
namespace {

constexpr double kSmallRotation = 0.02;  // vector part of a quaternion before it is normalised

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

}  // namespace

std::vector<SE3> motionGuesses(const MotionHistory& history) {
  if (!history.T_previous_reference) return {SE3()};
  const SE3& previous = *history.T_previous_reference;
  constexpr std::size_t kAll = 31;
  std::vector<SE3> guesses;
  guesses.reserve(kAll);
  SE3 constant_motion = previous;
  if (history.T_before_reference) {
    const SE3 T_previous_before = previous * history.T_before_reference->inverse();
    constant_motion = T_previous_before * previous;
    guesses.push_back(constant_motion);
    guesses.push_back(T_previous_before * constant_motion);
    guesses.push_back(SE3::exp(0.5 * T_previous_before.log()) * previous);
  }
  guesses.push_back(previous);
  guesses.emplace_back();
  for (int axes = 1; axes <= 3; ++axes) appendSmallRotations(constant_motion, axes, guesses);
  return guesses;
}

}  // namespace dsorb::track
