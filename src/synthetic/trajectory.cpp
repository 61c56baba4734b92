// SPDX-License-Identifier: BSD-3-Clause
#include "synthetic/trajectory.h"

#include "base/random.h"
#include "synthetic/places.h"

#include <cmath>

namespace dsorb::synthetic {
namespace {

constexpr double kCameraHeight = 1.65;  // as KITTI's cameras [m]

/// Start phase of a path [rad].
double startPhase(std::uint64_t seed) {
  return 2 * M_PI * Random(seed ^ 0x7A7AULL).uniform();
}

/// Camera axes (x right, y down, z ahead) turned by heading, then pitch, then roll [rad].
Eigen::Quaterniond orientation(double heading, double pitch, double roll) {
  return so3Exp({0, heading, 0}) * so3Exp({pitch, 0, 0}) * so3Exp({0, 0, roll});
}

/// Sum of two incommensurable sines, within [-1, 1]: no two seconds of a path are alike.
double wave(double phase) {
  return 0.7 * std::sin(phase) + 0.3 * std::sin(2.63 * phase + 1.0);
}

double streetPosition(double frame, double phase) {
  return kStreetStep * frame + 0.5 * std::sin(0.25 * frame + phase);
}

}  // namespace

SE3 streetPose(double frame, std::uint64_t seed) {
  const double phase = startPhase(seed);
  const double z = streetPosition(frame, phase);
  const StreetAxis axis = streetAxis(z);
  const double sway = 0.25 * std::sin(0.05 * frame + phase);
  const double sway_heading = 0.25 * 0.05 / kStreetStep * std::cos(0.05 * frame + phase);
  const double pitch = 0.005 * wave(0.9 * frame + phase);
  const double roll = 0.004 * wave(0.5 * frame + 2 * phase);
  const double bounce = 0.015 * wave(0.8 * frame + 3 * phase);
  return {orientation(axis.heading + sway_heading, pitch, roll),
          Eigen::Vector3d(axis.x + sway, -kCameraHeight + bounce, z)};
}

SE3 roomPose(double frame, std::uint64_t seed) {
  const double phase = startPhase(seed);
  const double turn = 0.024 * frame + phase;  // one loop takes about nine seconds
  const Eigen::Vector3d position(
      1.1 * std::sin(turn), -1.35 + 0.18 * wave(1.7 * turn), -0.9 + 0.7 * std::cos(turn));
  const double heading = -0.18 * std::sin(turn) + 0.16 * wave(0.031 * frame + phase);
  const double pitch = -0.16 + 0.07 * wave(0.043 * frame + 2 * phase);
  const double roll = 0.05 * wave(0.037 * frame + 3 * phase);
  return {orientation(heading, pitch, roll), position};
}

SE3 planePose(double frame, std::uint64_t seed) {
  const double phase = startPhase(seed);
  const Eigen::Vector3d position(1.5 * std::sin(0.025 * frame + phase),
                                 0.8 * std::sin(0.031 * frame + 2 * phase),
                                 0.6 * std::sin(0.028 * frame + 3 * phase));
  return {orientation(0.12 * wave(0.026 * frame + phase),
                      0.10 * wave(0.03 * frame + 2 * phase),
                      0.15 * wave(0.02 * frame + 3 * phase)),
          position};
}

SE3 rotationPose(double frame, std::uint64_t seed) {
  SE3 pose = roomPose(0, seed);
  const double turn = 0.05 * frame;
  const Eigen::Quaterniond rotation =
      orientation(0.45 * std::sin(turn), 0.12 * std::sin(1.7 * turn), 0.10 * std::sin(1.3 * turn));
  return {pose.unitQuaternion() * rotation, pose.translation()};
}

SE3 movingCarPose(double frame, std::uint64_t seed) {
  // Starts ahead and drives a little slower: it comes nearer by 6 cm per frame.
  const double z = 13 + 0.95 * streetPosition(frame, startPhase(seed));
  const StreetAxis axis = streetAxis(z);
  return {so3Exp({0, axis.heading, 0}), Eigen::Vector3d(axis.x + 0.4, -0.95, z)};
}

SE3 movingVanPose(double frame, std::uint64_t seed, double ahead, double height) {
  const double z = ahead + streetPosition(frame, startPhase(seed));
  const StreetAxis axis = streetAxis(z);
  const double swerve = 1.2 * std::sin(0.13 * frame);  // at most 16 cm per frame
  return {so3Exp({0, axis.heading, 0}), Eigen::Vector3d(axis.x + swerve, -height, z)};
}

SE3 movingCratePose(double frame, std::uint64_t seed) {
  const double phase = 0.04 * frame + startPhase(seed);
  return {so3Exp({0, 0.5 * phase, 0}),
          Eigen::Vector3d(1.2 * std::sin(phase), -1.1 + 0.2 * std::cos(phase), 1.2)};
}

}  // namespace dsorb::synthetic
