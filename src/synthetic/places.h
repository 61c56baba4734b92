// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "synthetic/scene.h"

#include <cstdint>

namespace dsorb::synthetic {

// World axes of all places: x right, y down, z ahead; the floor is y = 0, lengths are metres.

/// Pose at a position [m], turned about the vertical by a heading [rad] from z towards x.
inline SE3 uprightPose(const Eigen::Vector3d& position, double heading = 0) {
  return {so3Exp({0, heading, 0}), position};
}

/// Position [m] and heading [rad] of the middle of the street.
struct StreetAxis {
  double x = 0;
  double z = 0;
  double heading = 0;
};
/// @param z [m] along it
[[nodiscard]] StreetAxis streetAxis(double z);
/// The same of the street round a block of houses.
/// @param along way from the start [m], any number of times round
[[nodiscard]] StreetAxis blockAxis(double along);
constexpr double kBlockLength = 260;  ///< once round the block [m]

/// Slightly winding street between facades, with parked cars, posts and trees.
/// @param length of the drive [m]; the houses go on beyond it
[[nodiscard]] Scene makeStreet(std::uint64_t seed, double length);
/// Street round a block of houses.
[[nodiscard]] Scene makeBlock(std::uint64_t seed);

/// Half sizes of the room [m]; its middle is the origin, on the floor.
constexpr double kRoomHalfWidth = 3.4;
constexpr double kRoomHalfLength = 3.0;
constexpr double kRoomHeight = 2.7;

/// Furnished room, walls and ceiling included.
[[nodiscard]] Scene makeRoom(std::uint64_t seed);

/// Tilt of the plane out of the image plane of a camera that looks along z [rad].
constexpr double kPlaneTilt = 0.38;
/// Distance of the plane from the origin along z [m].
constexpr double kPlaneDistance = 4.0;

/// One endless textured plane through (0, 0, kPlaneDistance), tilted about x and half as much
/// about y.
[[nodiscard]] Scene makePlane(std::uint64_t seed);
/// Normal of that plane, unit length, towards the origin.
[[nodiscard]] Eigen::Vector3d planeNormal();

/// Index of a cuboid with edges of `size` [m] that is added to a scene, to be moved by its pose.
/// @param painted textured as parked cars are; else with many more corners
int addMovingBox(Scene& scene,
                 std::uint64_t seed,
                 const Eigen::Vector3d& size,
                 bool painted = false);

}  // namespace dsorb::synthetic
