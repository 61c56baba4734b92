// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/geometry/se3.h"

#include "geometry/row_motion.h"

#include <optional>
#include <vector>

namespace dsorb::track {

/// Poses of two frames before the one to be tracked, relative to the tracking reference; the elder
/// is known only together with the younger.
struct MotionHistory {
  std::optional<TimedPose> previous;
  std::optional<TimedPose> before;  ///< the previous frame

  /// Appends the pose of a new frame, unless it repeats the one before: of the motion it tells
  /// nothing.
  void push(const TimedPose& newest);
  /// This history relative to another reference frame.
  [[nodiscard]] MotionHistory relativeTo(const SE3& T_new_old) const;
};

/// Poses reference -> new frame worth trying, most likely first: constant, double and half motion,
/// no motion since the previous frame, no motion since the reference, and constant motion times one
/// of 26 small rotations (single-axis ones first). With no frame before the previous one the motion
/// counts as none; with no previous frame identity is all.
/// @param time of the new frame [s]
/// @source front end of DSO as published, but for times: constant is the velocity
[[nodiscard]] std::vector<SE3> motionGuesses(const MotionHistory& history, double time);

}  // namespace dsorb::track
