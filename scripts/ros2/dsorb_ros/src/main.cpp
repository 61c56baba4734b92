// SPDX-License-Identifier: BSD-3-Clause
#include "node.h"

int main(int argc, char** argv) {
  rclcpp::init(argc, argv);
  try {
    rclcpp::spin(std::make_shared<dsorb_ros::DsorbNode>());
  } catch (const std::exception& error) {
    RCLCPP_FATAL(rclcpp::get_logger("dsorb"), "%s", error.what());
    return 1;
  }
  rclcpp::shutdown();
  return 0;
}
