// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/calibration.h"
#include "dsorb/geometry/se3.h"
#include "dsorb/image/affine_brightness.h"
#include "dsorb/image/frame.h"
#include "dsorb/init/report.h"

#include <Eigen/Core>

#include <optional>
#include <vector>

namespace dsorb {

/// One of the frames since the reference. A frame that could not be posed is listed without a pose.
/// Posed frames but the reference have a covariance where the initializer estimates them. It
/// includes the error of the structure that all frames share, so that two frames are not
/// independent; but not for those that `orb` has only posed after its adjustment.
struct PosedFrame {
  FramePtr frame;                      ///< the frame as given
  std::optional<SE3> T_cam_ref;        ///< none: the frame could not be posed
  AffineBrightness affine;             ///< relative to the reference, which has a = b = 0
  std::optional<Matrix6d> covariance;  ///< of exp(xi) * T_cam_ref, [translation; rotation]
};

/// A pixel with its inverse depth. With a rolling shutter the pixel is where its row sees the
/// point, and the inverse depth belongs to the time of the pose, as the pixels of map points do.
struct InitPoint {
  int host = 0;                 ///< index into the result's frames
  Eigen::Vector2f pixel{0, 0};  ///< in the host, level 0; whole numbers from `orb` [px]
  float inverse_depth = 0;      ///< inverse of the host camera's z [1/unit]
  float variance = 0;           ///< variance of the inverse depth [1/unit^2]
  int observations = 0;         ///< measurements that agree on it
};

/// Length of a start's unit.
struct MetricScale {
  double metres = 0;          ///< length of one unit [m]
  double relative_sigma = 0;  ///< standard deviation of its logarithm [-]
  int depths = 0;             ///< number of known depths that took part
};

/// Result of an initializer. The front frame is the reference, with identity pose and a = b = 0;
/// the back frame is the newest one and has a pose. The unit of length is chosen such that the mean
/// inverse depth of the reference's points is 1.
struct InitializationResult {
  std::vector<PosedFrame> frames;  ///< all since the reference, in the order given, but those
                                   ///< that InitializerOptions::max_waiting_mb had no room for
  std::vector<InitPoint> points;   ///< points of all hosts
  InitReport report;               ///< what led to it
  /// Readout of a rolling shutter, as the initializer took it: estimated where the calibration has
  /// a sigma.
  std::optional<Readout> readout{};
  /// Metres of the unit, where frames came with priors: from depths of the reference that the start
  /// agrees with, or else from distances.
  std::optional<MetricScale> metric{};
  /// Pixels of all images that move with the camera (a bonnet, a watermark): corners were seen to.
  std::vector<Eigen::Vector2f> stuck{};
};

/// Checks every clause of the hand-over that can be seen from the result alone.
/// @throws std::logic_error naming the clause and the values that break it
void checkInvariants(const InitializationResult& result);

}  // namespace dsorb
