// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "geometry/motion_prior.h"
#include "geometry/row_motion.h"

#include <cstddef>
#include <optional>
#include <vector>

namespace dsorb {

/// A pose with the velocity that the image shows.
struct Passage {
  TimedPose pose;
  std::optional<Vector6d> velocity{};  ///< of RowMotion [unit/s; rad/s]
};

/// Poses of the newest frames, and how well such poses tell the motion between them: a parabola
/// through three misses the velocity at its end by jerk times squared interval over 3, in the
/// middle by half of that, and the next pose by jerk times the interval to the third. So what the
/// sequence itself shows of the latter gives the former; noise of the poses enters both alike.
class RecentMotion {
 public:
  void push(const Passage& newest);
  /// Standard deviations by which a pose misses what the newest frames let expect, the larger of
  /// translation and rotation; empty before there are enough frames.
  [[nodiscard]] std::optional<double> surprise(const TimedPose& next) const;
  /// Poses are relative to another frame from now on.
  void changeReference(const SE3& T_new_old);
  /// The nearest first.
  [[nodiscard]] std::vector<TimedPose> poses() const;
  [[nodiscard]] std::size_t size() const { return recent_.size(); }
  /// Standard deviation of the velocity at the end of a parabola [unit/s; rad/s].
  [[nodiscard]] Vector6d sigma() const;
  /// Motion at the newest frame, by those before it.
  [[nodiscard]] MotionPrior atEnd() const;
  /// Motion at the frame before the newest, by its two neighbours, their velocities included where
  /// all are known; there are at least two poses.
  [[nodiscard]] MotionPrior inMiddle() const;

 private:
  /// What sigma() is the deviation of: by which a pose misses the parabola through the newest three
  /// [unit/s; rad/s].
  [[nodiscard]] std::optional<Vector6d> missed(const TimedPose& next) const;

  std::vector<Passage> recent_;  // the newest first
  // Sums over the newest frames [squared units of a velocity].
  double translation_ = 0;
  double rotation_ = 0;
  double weight_ = 0;
};

/// Motion at a pose by the polynomial of fourth degree through it and two neighbours whose
/// velocities are known. It sees more than a parabola of a motion that three poses do not resolve.
/// The three have different times.
[[nodiscard]] RowMotion motionBetween(const TimedPose& pose,
                                      const Passage& before,
                                      const Passage& after);

}  // namespace dsorb
