// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "geometry_msgs/msg/transform_stamped.hpp"
#include "rclcpp/rclcpp.hpp"
#include "tf2_msgs/msg/tf_message.hpp"

namespace tf2_ros {
class TransformBroadcaster {
 public:
  explicit TransformBroadcaster(rclcpp::Node& node)
      : publisher_(node.create_publisher<tf2_msgs::msg::TFMessage>("/tf", 100)) {}
  void sendTransform(const geometry_msgs::msg::TransformStamped& transform) {
    tf2_msgs::msg::TFMessage message;
    message.transforms = {transform};
    publisher_->publish(message);
  }

 private:
  rclcpp::Publisher<tf2_msgs::msg::TFMessage>::SharedPtr publisher_;
};
}  // namespace tf2_ros
