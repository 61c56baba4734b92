// SPDX-License-Identifier: BSD-3-Clause
#include "node.h"

#include <dsorb/error.h>
#include <dsorb/io/calibration_reader.h>
#include <opencv2/imgcodecs.hpp>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <set>
#include <stdexcept>

namespace dsorb_ros {
namespace {

const std::set<std::string> kOwn = {"preset",
                                    "calibration",
                                    "mask",
                                    "width",
                                    "compressed",
                                    "world_frame",
                                    "save_to",
                                    "use_sim_time"};

/// All other parameters are options under their full names.
dsorb::Config configOf(const rclcpp::Node& node, const std::string& preset) {
  dsorb::ConfigSources sources;
  sources.preset = preset;
  sources.program_defaults = {{"num_threads", "0", "dsorb_ros"}};
  for (const std::string& name : node.list_parameters({}, 0).names) {
    if (kOwn.count(name) != 0 || name.rfind("qos_overrides.", 0) == 0) continue;
    const rclcpp::Parameter parameter = node.get_parameter(name);
    sources.assignments.push_back({name, parameter.value_to_string(), "parameter " + name});
  }
  return dsorb::loadConfig(sources);
}

void addLine(std::string& text, const geometry_msgs::msg::PoseStamped& stamped) {
  char line[256];
  const auto& [position, orientation] = stamped.pose;
  std::snprintf(line,
                sizeof line,
                "%d.%09u %.9f %.9f %.9f %.9f %.9f %.9f %.9f\n",
                stamped.header.stamp.sec,
                stamped.header.stamp.nanosec,
                position.x,
                position.y,
                position.z,
                orientation.x,
                orientation.y,
                orientation.z,
                orientation.w);
  text += line;
}

}  // namespace

DsorbNode::DsorbNode(const rclcpp::NodeOptions& options)
    : Node("dsorb",
           rclcpp::NodeOptions(options).automatically_declare_parameters_from_overrides(true)),
      transforms_(*this) {
  const std::string preset = text("preset");
  config_ = configOf(*this, preset.empty() ? "default" : preset);
  world_frame_ = text("world_frame").empty() ? "odom" : text("world_frame");
  save_to_ = text("save_to").empty() ? "." : text("save_to");
  width_ = has_parameter("width") ? static_cast<int>(get_parameter("width").as_int()) : 0;
  odometry_publisher_ = create_publisher<nav_msgs::msg::Odometry>("~/odometry", 10);
  path_publisher_ = create_publisher<nav_msgs::msg::Path>("~/path", 1);
  points_publisher_ = create_publisher<sensor_msgs::msg::PointCloud2>("~/points", 1);
  reset_service_ = create_service<Trigger>(
      "~/reset",
      [this](Trigger::Request::SharedPtr /*request*/, Trigger::Response::SharedPtr response) {
        if (odometry_) begin();
        response->success = true;
      });
  save_service_ =
      create_service<Trigger>("~/save",
                              [this](Trigger::Request::SharedPtr /*request*/,
                                     Trigger::Response::SharedPtr response) { save(*response); });
  if (!text("calibration").empty()) calibration_ = dsorb::readCalibration(text("calibration"));
  subscribe();
}

std::string DsorbNode::text(const std::string& name) {
  return has_parameter(name) ? get_parameter(name).as_string() : std::string();
}

void DsorbNode::subscribe() {
  const auto qos = rclcpp::SensorDataQoS().keep_last(4);
  if (!calibration_) {
    camera_infos_ = create_subscription<CameraInfo>(
        "camera_info", qos, [this](const CameraInfo::ConstSharedPtr& info) {
          onCameraInfo(*info);
        });
  }
  if (has_parameter("compressed") && get_parameter("compressed").as_bool()) {
    compressed_images_ = create_subscription<CompressedImage>(
        "image/compressed", qos, [this](const CompressedImage::ConstSharedPtr& image) {
          onImage(*image);
        });
  } else {
    images_ = create_subscription<Image>(
        "image", qos, [this](const Image::ConstSharedPtr& image) { onImage(*image); });
  }
}

void DsorbNode::onCameraInfo(const CameraInfo& info) {
  if (calibration_) return;
  try {
    calibration_ = calibrationOf(info);
  } catch (const std::exception& error) {
    RCLCPP_ERROR_ONCE(get_logger(), "%s", error.what());
  }
}

template <typename Message>
void DsorbNode::onImage(const Message& message) {
  if (!calibration_) {
    RCLCPP_WARN_ONCE(get_logger(), "images come, but no camera_info yet");
    return;
  }
  try {
    process(pixelsOf(message), message.header);
  } catch (const std::exception& error) {
    RCLCPP_ERROR(get_logger(), "image left out: %s", error.what());
  }
}

void DsorbNode::process(const Pixels& pixels, const std_msgs::msg::Header& header) {
  if (!rectifier_)
    start(dsorb::calibrationForSize(*calibration_, pixels.view.width, pixels.view.height));
  dsorb::FrameInfo info;
  info.timestamp = header.stamp.sec + 1e-9 * header.stamp.nanosec;
  if (next_id_ > 0 && info.timestamp <= newest_) {
    throw std::invalid_argument(
        "its time is not after that of the image before; after a jump of the clock call ~/reset");
  }
  info.id = dsorb::FrameId{next_id_++};
  newest_ = info.timestamp;
  const dsorb::FrameEstimate estimate = odometry_->process(rectifier_->frame(pixels.view, info));
  publish(estimate, header);
  if (estimate.state == dsorb::OdometryState::kLost) {
    RCLCPP_WARN(get_logger(),
                "lost; the next start goes on from the last pose, in a unit of its own");
    odometry_->restart();
    window_.clear();
  }
}

/// Makes the rectifier for the size of the first image.
void DsorbNode::start(const dsorb::Calibration& calibration) {
  auto rectifier = std::make_unique<dsorb::Rectifier>(
      width_ > 0 && width_ < calibration.lens.width ? dsorb::withOutputWidth(calibration, width_)
                                                    : calibration);
  for (const std::string& warning : rectifier->warnings())
    RCLCPP_WARN(get_logger(), "%s", warning.c_str());
  if (!text("mask").empty()) {
    const cv::Mat mask = cv::imread(text("mask"), cv::IMREAD_GRAYSCALE);
    if (mask.empty()) throw std::invalid_argument(text("mask") + ": no image");
    rectifier->setMask({mask.data, mask.cols, mask.rows, mask.step});
  }
  rectifier_ = std::move(rectifier);
  begin();
}

/// A new map and a new origin.
void DsorbNode::begin() {
  odometry_ = std::make_unique<dsorb::Odometry>(rectifier_->camera(), config_.options);
  odometry_->addObserver(this);
  window_.clear();
  finished_.clear();
  path_.poses.clear();
  segment_ = -1;
  next_id_ = 0;
  T_odom_world_ = bodyFromOptical();
  T_odom_cam_ = bodyFromOptical();
}

void DsorbNode::onFrame(const dsorb::FrameEstimate& estimate) {
  if (!estimate.T_world_cam) return;
  if (segment_ !=
      estimate.segment) {  // the first goes on from the origin, another one from the last pose
    T_odom_world_ =
        segment_ < 0 ? bodyFromOptical() : T_odom_cam_ * estimate.T_world_cam->inverse();
    segment_ = estimate.segment;
  }
  T_odom_cam_ = T_odom_world_ * *estimate.T_world_cam;
}

void DsorbNode::onKeyframe(const dsorb::KeyframeSnapshot& keyframe) {
  window_[keyframe.id.value] = keyframe;
}

void DsorbNode::onKeyframeRetired(const dsorb::KeyframeSnapshot& keyframe) {
  window_.erase(keyframe.id.value);
  finished_.push_back(keyframe);
}

void DsorbNode::publish(const dsorb::FrameEstimate& estimate, const std_msgs::msg::Header& header) {
  if (!estimate.T_world_cam) return;
  nav_msgs::msg::Odometry message;
  message.header = header;
  message.header.frame_id = world_frame_;
  message.child_frame_id = header.frame_id;
  message.pose.pose = poseOf(T_odom_cam_);
  if (estimate.world_covariance)
    message.pose.covariance = covarianceOf(T_odom_cam_, *estimate.world_covariance);
  odometry_publisher_->publish(message);

  geometry_msgs::msg::TransformStamped transform;
  transform.header = message.header;
  transform.child_frame_id = header.frame_id;
  transform.transform.translation.x = message.pose.pose.position.x;
  transform.transform.translation.y = message.pose.pose.position.y;
  transform.transform.translation.z = message.pose.pose.position.z;
  transform.transform.rotation = message.pose.pose.orientation;
  transforms_.sendTransform(transform);

  path_.header = message.header;
  path_.poses.emplace_back();
  path_.poses.back().header = message.header;
  path_.poses.back().pose = message.pose.pose;
  if (!estimate.is_keyframe) return;
  path_publisher_->publish(path_);
  std::vector<dsorb::KeyframeSnapshot> keyframes = std::move(finished_);
  finished_.clear();
  for (const auto& [id, keyframe] : window_) keyframes.push_back(keyframe);
  sensor_msgs::msg::PointCloud2 cloud = cloudOf(keyframes, T_odom_world_);
  cloud.header = message.header;
  points_publisher_->publish(cloud);
}

/// The path in the form of TUM.
void DsorbNode::save(Trigger::Response& response) {
  std::string trajectory;
  for (const geometry_msgs::msg::PoseStamped& pose : path_.poses) addLine(trajectory, pose);
  const std::filesystem::path file = std::filesystem::path(save_to_) / "trajectory.txt";
  std::error_code ignored;
  std::filesystem::create_directories(save_to_, ignored);
  std::ofstream stream(file);
  stream << trajectory << std::flush;
  response.success = stream.good();
  response.message =
      file.string() + (stream.good() ? ": " + std::to_string(path_.poses.size()) + " poses"
                                     : ": cannot be written");
}

}  // namespace dsorb_ros
