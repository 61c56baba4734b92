// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/geometry/se3.h"
#include "dsorb/image/frame.h"
#include "dsorb/image/image_view.h"

#include <Eigen/Core>

#include <optional>
#include <vector>

namespace dsorb {

/// Depth along the optical axis that the caller knows of a frame's pixels: RGB-D, LiDAR, a network.
struct DepthPrior {
  int width = 0;             ///< width of the frame [px]
  int height = 0;            ///< height of the frame [px]
  std::vector<float> depth;  ///< row by row [m]; NaN or not above 0 where it is not known
  std::vector<float> sigma;  ///< standard deviations, one a depth [m]; above 0 where it is known
  /// Whether depths are in metres. Otherwise they are right but for one factor, as those of a
  /// network may be, and a start has no metric scale from them.
  bool metric = true;
};

/// Depth at a point of the image, for example a LiDAR return projected into it.
struct DepthAtPixel {
  float x = 0;      ///< [px]
  float y = 0;      ///< [px]
  float depth = 0;  ///< along the optical axis, above 0 [m]
  float sigma = 0;  ///< standard deviation, above 0 [m]
};

/// How the camera has moved since an earlier frame: turned, by a gyroscope, or turned and moved, by
/// another odometry. Errors of different frames are independent. Made by rotationSince() and
/// poseSince().
struct PosePrior {
  FrameId since;      ///< the frame before, or another one that came earlier
  SE3 T_frame_since;  ///< coordinates of then to now [m]
  /// Covariance of xi = [translation; rotation] in exp(xi) * T_frame_since, in m and rad; positive
  /// definite.
  Matrix6d covariance = Matrix6d::Identity();
  /// False: only the rotation is known, and only its block of the covariance counts.
  bool has_translation = false;
};

/// How far the camera has moved since an earlier frame, by wheels or another odometry.
struct DistancePrior {
  FrameId since;      ///< the frame before, or another one that came earlier
  double metres = 0;  ///< between the two camera centres, at least 0 [m]
  double sigma = 0;   ///< standard deviation, above 0 [m]
};

/// What the caller knows of a frame beside its image. Shared and never changed once a frame has it.
/// An initializer weighs it, tests it against the images and says in InitReport what became of it:
/// a claimed standard deviation is what the caller believes, and may be wrong.
struct FramePriors {
  std::optional<DepthPrior> depth{};  ///< depths of the frame's pixels
  std::optional<PosePrior> pose{};    ///< motion of the camera; a translation gives a scale, too
  std::optional<DistancePrior> distance{};  ///< path of the camera; it gives a start its scale
};

/// Depths of all pixels, whose standard deviation is hypot(sigma, relative_sigma * depth).
/// @param depth          float [m]; NaN or not above 0 where it is not known
/// @param sigma          constant part [m]
/// @param relative_sigma proportional part [-]
/// @throws std::invalid_argument on an image that is not float, and where sigmas are negative, not
///         finite or both 0
[[nodiscard]] DepthPrior denseDepth(const ImageView& depth, double sigma, double relative_sigma);

/// Depths of a few pixels, entered at the nearest ones; of two in one pixel the nearer one stays.
/// Samples outside the image are left out.
/// @param width  of the frame [px]
/// @param height of the frame [px]
/// @throws std::invalid_argument on a size, a depth or a sigma that is not above 0 and finite
[[nodiscard]] DepthPrior sparseDepth(int width,
                                     int height,
                                     const std::vector<DepthAtPixel>& samples);

/// Rotation that a gyroscope has measured.
/// @param R_frame_since directions of the earlier frame to this one
/// @param covariance    of the left increment, axes of this frame's camera [rad^2]
/// @throws std::invalid_argument on a matrix that is no rotation (R R^T is not near 1)
[[nodiscard]] PosePrior rotationSince(FrameId since,
                                      const Eigen::Matrix3d& R_frame_since,
                                      const Eigen::Matrix3d& covariance);

/// The same with one standard deviation about every axis. @param sigma above 0 [rad]
[[nodiscard]] PosePrior rotationSince(FrameId since,
                                      const Eigen::Matrix3d& R_frame_since,
                                      double sigma);

/// Pose that a gyroscope and wheels, or another odometry, have measured.
/// @param T_frame_since coordinates of the earlier camera to this one's [m]
/// @param covariance    of exp(xi) * T_frame_since, [translation; rotation] in m and rad
[[nodiscard]] PosePrior poseSince(FrameId since,
                                  const SE3& T_frame_since,
                                  const Matrix6d& covariance);

}  // namespace dsorb
