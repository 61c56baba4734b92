// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/geometry/se3.h"

#include <optional>
#include <vector>

namespace dsorb::track {

/// Poses of the two frames before the one to be tracked, relative to the tracking reference. The
/// elder is known only together with the younger.
struct MotionHistory {
  std::optional<SE3> T_previous_reference;
  std::optional<SE3> T_before_reference;  ///< of the frame before the previous one

  /// Appends the pose of a new frame.
  void push(const SE3& T_frame_reference) {
    T_before_reference = T_previous_reference;
    T_previous_reference = T_frame_reference;
  }
  /// This history relative to another reference frame.
  [[nodiscard]] MotionHistory relativeTo(const SE3& T_new_old) const {
    const SE3 T_old_new = T_new_old.inverse();
    MotionHistory moved;
    if (T_previous_reference) moved.T_previous_reference = *T_previous_reference * T_old_new;
    if (T_before_reference) moved.T_before_reference = *T_before_reference * T_old_new;
    return moved;
  }
};

/// Poses reference -> new frame worth trying, most likely first: constant, double and half motion,
/// no motion since the previous frame, no motion since the reference, and constant motion times one
/// of 26 small rotations (single-axis ones first). With no frame before the previous one the motion
/// counts as none; with no previous frame identity is all.
/// @source front end of DSO as published
[[nodiscard]] std::vector<SE3> motionGuesses(const MotionHistory& history);

}  // namespace dsorb::track
