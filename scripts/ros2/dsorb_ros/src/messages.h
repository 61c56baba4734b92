// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <dsorb/camera/rectifier.h>
#include <dsorb/odometry/observer.h>
#include <geometry_msgs/msg/pose.hpp>
#include <sensor_msgs/msg/camera_info.hpp>
#include <sensor_msgs/msg/compressed_image.hpp>
#include <sensor_msgs/msg/image.hpp>
#include <sensor_msgs/msg/point_cloud2.hpp>

#include <array>
#include <cstdint>
#include <vector>

/// Messages of ROS to values of dsorb and back.
namespace dsorb_ros {

/// An image of a message as the rectifier takes it.
struct Pixels {
  std::vector<std::uint8_t> owned;  ///< where the message's own bytes do not serve
  dsorb::RawImage view;             ///< of the message's bytes or of `owned`
};

/// @throws std::invalid_argument on another encoding, or fewer bytes than it announces
[[nodiscard]] Pixels pixelsOf(const sensor_msgs::msg::Image& message);
/// @throws std::invalid_argument where it is no image
[[nodiscard]] Pixels pixelsOf(const sensor_msgs::msg::CompressedImage& message);

/// Region of interest and binning are taken as REP 104 has them.
/// @throws dsorb::IoError on another model of distortion
/// @throws std::invalid_argument where nobody calibrated the camera
[[nodiscard]] dsorb::Calibration calibrationOf(const sensor_msgs::msg::CameraInfo& message);

/// Axes of a camera (z forward) to those of a body (x forward, z up): REP 103.
[[nodiscard]] dsorb::SE3 bodyFromOptical();

[[nodiscard]] geometry_msgs::msg::Pose poseOf(const dsorb::SE3& T);

/// @param covariance of exp(xi) * T_cam_world
/// @return of translation and rotation about the fixed axes of the world, row by row
[[nodiscard]] std::array<double, 36> covarianceOf(const dsorb::SE3& T_world_cam,
                                                  const dsorb::Matrix6d& covariance);

/// Points x, y, z and intensity, those that are known to 30 % of their depth.
[[nodiscard]] sensor_msgs::msg::PointCloud2 cloudOf(
    const std::vector<dsorb::KeyframeSnapshot>& keyframes, const dsorb::SE3& T_odom_world);

}  // namespace dsorb_ros
