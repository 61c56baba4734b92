// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "messages.h"

#include <dsorb/io/config.h>
#include <dsorb/odometry/odometry.h>
#include <nav_msgs/msg/odometry.hpp>
#include <nav_msgs/msg/path.hpp>
#include <rclcpp/rclcpp.hpp>
#include <std_srvs/srv/trigger.hpp>
#include <tf2_ros/transform_broadcaster.h>

#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

namespace dsorb_ros {

/// Images and camera_info in; odometry, path, points and the transform out. README.md says which
/// topics, parameters and services.
class DsorbNode : public rclcpp::Node, private dsorb::OdometryObserver {
 public:
  /// @throws dsorb::ConfigError on parameters that are no options
  explicit DsorbNode(const rclcpp::NodeOptions& options = rclcpp::NodeOptions());

 private:
  using Image = sensor_msgs::msg::Image;
  using CompressedImage = sensor_msgs::msg::CompressedImage;
  using CameraInfo = sensor_msgs::msg::CameraInfo;
  using Trigger = std_srvs::srv::Trigger;

  std::string text(const std::string& name);
  void subscribe();
  void onCameraInfo(const CameraInfo& info);
  template <typename Message>
  void onImage(const Message& message);
  void process(const Pixels& pixels, const std_msgs::msg::Header& header);
  void start(const dsorb::Calibration& calibration);
  void begin();
  void publish(const dsorb::FrameEstimate& estimate, const std_msgs::msg::Header& header);
  void save(Trigger::Response& response);

  void onFrame(const dsorb::FrameEstimate& estimate) override;
  void onKeyframe(const dsorb::KeyframeSnapshot& keyframe) override;
  void onKeyframeRetired(const dsorb::KeyframeSnapshot& keyframe) override;

  dsorb::Config config_;
  std::string world_frame_;
  std::string save_to_;
  int width_ = 0;
  int next_id_ = 0;
  int segment_ = -1;   // that T_odom_world_ is of
  double newest_ = 0;  // time of the frame before [s]
  dsorb::SE3 T_odom_world_;
  dsorb::SE3 T_odom_cam_;  // newest
  std::optional<dsorb::Calibration> calibration_;
  std::unique_ptr<dsorb::Rectifier> rectifier_;
  std::unique_ptr<dsorb::Odometry> odometry_;
  std::map<int, dsorb::KeyframeSnapshot> window_;  // by frame
  std::vector<dsorb::KeyframeSnapshot> finished_;  // since the points were published
  nav_msgs::msg::Path path_;
  rclcpp::Subscription<Image>::SharedPtr images_;
  rclcpp::Subscription<CompressedImage>::SharedPtr compressed_images_;
  rclcpp::Subscription<CameraInfo>::SharedPtr camera_infos_;
  rclcpp::Publisher<nav_msgs::msg::Odometry>::SharedPtr odometry_publisher_;
  rclcpp::Publisher<nav_msgs::msg::Path>::SharedPtr path_publisher_;
  rclcpp::Publisher<sensor_msgs::msg::PointCloud2>::SharedPtr points_publisher_;
  rclcpp::Service<Trigger>::SharedPtr reset_service_;
  rclcpp::Service<Trigger>::SharedPtr save_service_;
  tf2_ros::TransformBroadcaster transforms_;
};

}  // namespace dsorb_ros
