// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"

#include "estimate/pose_from_points.h"
#include "features/feature_matches.h"
#include "image/photometric.h"

#include <cstdint>
#include <optional>
#include <vector>

namespace dsorb {

/// Features of a frame whose distance is known. They need not keep the frame itself.
struct DescribedPoints {
  DescribedFrame corners;             ///< `frame` may be null
  std::vector<float> inverse_depths;  ///< by feature [1/unit]
};

/// The features of a frame near samples of its depth, each with that of the nearest one. A feature
/// beside an edge of the depth may get that of the other side.
DescribedPoints describePoints(const DescribedFrame& frame, const std::vector<DepthSample>& depths);

/// Where a frame shows points, to about a pixel; some matches are wrong.
/// @param camera of the points' frame
std::vector<PointObservation> matchPoints(const DescribedPoints& points,
                                          const DescribedFrame& frame,
                                          const PinholeCamera& camera);

constexpr int kMinPoseInliers = 15;

/// A pose that matches agree about.
struct MatchedPose {
  SE3 T_cam_host;
  /// Covariance of xi in exp(xi) * T_cam_host, [translation; rotation]; the points err
  /// independently here.
  Matrix6d covariance = Matrix6d::Zero();
  std::vector<char> inlier;  ///< by match
  int inliers = 0;
  double noise = 0;  ///< standard deviation of an inlier's coordinates [px]
};

/// Pose of a camera from matches with points, some of them wrong: a sample of three points that
/// most agree with, then all of these.
/// @param camera of the matched frame
/// @param seed   of the samples
/// @return nullopt where fewer than kMinPoseInliers agree
/// @source Lepetit, Moreno-Noguer, Fua, EPnP, IJCV 2009, and OpenCV's RANSAC
std::optional<MatchedPose> poseFromMatches(const std::vector<PointObservation>& matches,
                                           const PinholeCamera& camera,
                                           std::uint64_t seed);

/// Number of matches that agree with a pose as inliers do.
int countAgreeing(const std::vector<PointObservation>& matches,
                  const PinholeCamera& camera,
                  const SE3& T_cam_host);

}  // namespace dsorb
