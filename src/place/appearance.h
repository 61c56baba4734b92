// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"
#include "dsorb/odometry/observer.h"

#include "features/grey_image.h"

#include <opencv2/core.hpp>

#include <vector>

namespace dsorb::place {

/// A keyframe with its image at half the size, 8 bit.
struct ImagedKeyframe {
  const KeyframeSnapshot* keyframe = nullptr;
  cv::Mat image;
};

/// How far an image contradicts the pose that it was given among keyframes: the share of its cells,
/// 8 by 6, in which the points of the keyframes look otherwise. What stands in the way of a point
/// contradicts it, too, so a right pose has some of them. 1 where fewer than eight cells can be
/// compared, or nothing is alike; 0 where the cells of corners that agree with the pose are hardly
/// more alike than others, as patches tell nothing there: the camera has turned too far, or depths
/// are too coarse.
/// @param image   at half the size
/// @param camera  of the whole image
/// @param corners that agree with the pose [px of the whole image]
[[nodiscard]] double contradictedShare(const std::vector<ImagedKeyframe>& keyframes,
                                       const GreyImage& image,
                                       const PinholeCamera& camera,
                                       const SE3& T_world_cam,
                                       const std::vector<Eigen::Vector2f>& corners);

}  // namespace dsorb::place
