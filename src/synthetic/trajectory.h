// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/geometry/se3.h"

#include <cstdint>

namespace dsorb::synthetic {

// Camera paths as smooth functions of time, in the axes of the places: x right, y down, z ahead.

/// Mean way of the street drive [m per frame]; single frames lie between 1.0 and 1.3 m.
constexpr double kStreetStep = 1.15;

/// @param frame time in frames, fractions allowed @param seed start phase
/// @return T_world_cam
[[nodiscard]] SE3 streetPose(double frame, std::uint64_t seed);
[[nodiscard]] SE3 roomPose(double frame, std::uint64_t seed);
[[nodiscard]] SE3 planePose(double frame, std::uint64_t seed);
/// Position of roomPose(0), turning.
[[nodiscard]] SE3 rotationPose(double frame, std::uint64_t seed);

/// Pose of the box that moves by itself: a car ahead on the street, a crate elsewhere.
[[nodiscard]] SE3 movingCarPose(double frame, std::uint64_t seed);
/// Pose of the middle of a box that stays as far ahead of the street's camera and swerves.
/// @param ahead  middle to camera [m]
/// @param height of the middle above the street [m]
[[nodiscard]] SE3 movingVanPose(double frame, std::uint64_t seed, double ahead, double height);
[[nodiscard]] SE3 movingCratePose(double frame, std::uint64_t seed);

}  // namespace dsorb::synthetic
