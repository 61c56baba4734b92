// SPDX-License-Identifier: BSD-3-Clause
#include "messages.h"

#include <dsorb/io/calibration_reader.h>
#include <opencv2/imgcodecs.hpp>
#include <unistd.h>

#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <map>
#include <stdexcept>
#include <string>

namespace dsorb_ros {
namespace {

constexpr double kMostUncertain = 0.3;  // standard deviation of an inverse depth over itself

/// How an encoding's pixels lie, and which of their bytes are taken.
struct Encoding {
  dsorb::PixelFormat format;
  int channels;  // in the message
  int bytes;     // of a channel
};

// A mosaic of colours is taken as it is, as dsorb takes one that nobody announces.
const std::map<std::string, Encoding> kEncodings = {
    {"mono8", {dsorb::PixelFormat::kGrey8, 1, 1}},
    {"8UC1", {dsorb::PixelFormat::kGrey8, 1, 1}},
    {"mono16", {dsorb::PixelFormat::kGrey16, 1, 2}},
    {"16UC1", {dsorb::PixelFormat::kGrey16, 1, 2}},
    {"rgb8", {dsorb::PixelFormat::kRgb8, 3, 1}},
    {"bgr8", {dsorb::PixelFormat::kBgr8, 3, 1}},
    {"8UC3", {dsorb::PixelFormat::kBgr8, 3, 1}},
    {"rgba8", {dsorb::PixelFormat::kRgb8, 4, 1}},
    {"bgra8", {dsorb::PixelFormat::kBgr8, 4, 1}},
    {"8UC4", {dsorb::PixelFormat::kBgr8, 4, 1}},
    {"yuv422_yuy2", {dsorb::PixelFormat::kGrey8, 2, 1}},  // luma comes first
    {"yuyv", {dsorb::PixelFormat::kGrey8, 2, 1}}};

int channelsOf(dsorb::PixelFormat format) {
  return format == dsorb::PixelFormat::kGrey8 || format == dsorb::PixelFormat::kGrey16 ? 1 : 3;
}

/// The first channels of every pixel, in the machine's byte order.
std::vector<std::uint8_t> packed(const sensor_msgs::msg::Image& message, const Encoding& encoding) {
  const std::size_t kept = static_cast<std::size_t>(channelsOf(encoding.format) * encoding.bytes);
  const std::size_t pixel = static_cast<std::size_t>(encoding.channels * encoding.bytes);
  std::vector<std::uint8_t> bytes(kept * message.width * message.height);
  std::uint8_t* target = bytes.data();
  for (std::size_t y = 0; y < message.height; ++y) {
    const std::uint8_t* source = message.data.data() + y * message.step;
    for (std::size_t x = 0; x < message.width; ++x, source += pixel, target += kept) {
      std::memcpy(target, source, kept);
      if (encoding.bytes == 2 && message.is_bigendian) std::swap(target[0], target[1]);
    }
  }
  return bytes;
}

template <typename Values>
std::string listOf(const Values& values) {
  std::string text;
  char number[32];
  for (const double value : values) {
    std::snprintf(number, sizeof number, "%s%.17g", text.empty() ? "" : ", ", value);
    text += number;
  }
  return text;
}

/// As `ros2 topic echo` prints it, which is one of the forms of calibration files.
std::string yamlOf(const sensor_msgs::msg::CameraInfo& info) {
  const auto line = [](const char* key, std::uint32_t value) {
    return std::string(key) + ": " + std::to_string(value) + "\n";
  };
  const std::string model = info.distortion_model.empty() ? "plumb_bob" : info.distortion_model;
  return line("width", info.width) + line("height", info.height) + "distortion_model: " + model +
         "\nd: [" + listOf(info.d) + "]\nk: [" + listOf(info.k) + "]\n" +
         line("binning_x", info.binning_x) + line("binning_y", info.binning_y) + "roi:\n" +
         line("  x_offset", info.roi.x_offset) + line("  y_offset", info.roi.y_offset) +
         line("  height", info.roi.height) + line("  width", info.roi.width);
}

void addField(sensor_msgs::msg::PointCloud2& cloud, const char* name) {
  sensor_msgs::msg::PointField field;
  field.name = name;
  field.offset = cloud.point_step;
  field.datatype = sensor_msgs::msg::PointField::FLOAT32;
  field.count = 1;
  cloud.fields.push_back(field);
  cloud.point_step += sizeof(float);
}

void addPoint(sensor_msgs::msg::PointCloud2& cloud, const Eigen::Vector3d& p, float intensity) {
  const std::array<float, 4> values = {
      static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z()), intensity};
  const auto* bytes = reinterpret_cast<const std::uint8_t*>(values.data());
  cloud.data.insert(cloud.data.end(), bytes, bytes + sizeof values);
  ++cloud.width;
}

}  // namespace

Pixels pixelsOf(const sensor_msgs::msg::Image& message) {
  const auto found = kEncodings.find(message.encoding);
  if (found == kEncodings.end()) {
    throw std::invalid_argument(
        "encoding '" + message.encoding +
        "': expected mono8, mono16, rgb8, bgr8, rgba8, bgra8 or yuv422_yuy2");
  }
  const Encoding& encoding = found->second;
  const std::size_t row =
      std::size_t{message.width} * static_cast<std::size_t>(encoding.channels * encoding.bytes);
  if (message.step < row || message.data.size() < std::size_t{message.step} * message.height) {
    throw std::invalid_argument(std::to_string(message.data.size()) + " bytes, rows of " +
                                std::to_string(message.step) + ": expected " +
                                std::to_string(message.height) + " rows of at least " +
                                std::to_string(row));
  }
  Pixels pixels;
  pixels.view.width = static_cast<int>(message.width);
  pixels.view.height = static_cast<int>(message.height);
  pixels.view.format = encoding.format;
  if (encoding.channels == channelsOf(encoding.format) && encoding.bytes == 1) {
    pixels.view.data = message.data.data();
    pixels.view.stride_bytes = message.step;
  } else {
    pixels.owned = packed(message, encoding);
    pixels.view.data = pixels.owned.data();
  }
  return pixels;
}

Pixels pixelsOf(const sensor_msgs::msg::CompressedImage& message) {
  const cv::Mat image =
      message.data.empty() ? cv::Mat() : cv::imdecode(message.data, cv::IMREAD_GRAYSCALE);
  if (image.empty()) {
    throw std::invalid_argument("compressed as '" + message.format + "': expected JPEG or PNG");
  }
  Pixels pixels;
  pixels.owned.assign(image.datastart, image.dataend);
  pixels.view = {
      pixels.owned.data(), image.cols, image.rows, dsorb::PixelFormat::kGrey8, image.step};
  return pixels;
}

dsorb::Calibration calibrationOf(const sensor_msgs::msg::CameraInfo& message) {
  if (!(message.k[0] > 0)) {
    throw std::invalid_argument(
        "camera_info: its K is 0: nobody calibrated this camera; give a file by the parameter "
        "`calibration`");
  }
  const std::filesystem::path file = std::filesystem::temp_directory_path() /
                                     ("dsorb_camera_info_" + std::to_string(getpid()) + ".yaml");
  std::ofstream(file) << yamlOf(message);
  dsorb::Calibration calibration;
  try {
    calibration = dsorb::readCalibration(file);
  } catch (...) {
    std::filesystem::remove(file);
    throw;
  }
  std::filesystem::remove(file);
  return calibration;
}

dsorb::SE3 bodyFromOptical() {
  Eigen::Matrix3d R;
  R << 0, 0, 1, -1, 0, 0, 0, -1, 0;
  return {R, Eigen::Vector3d::Zero()};
}

geometry_msgs::msg::Pose poseOf(const dsorb::SE3& T) {
  geometry_msgs::msg::Pose pose;
  pose.position.x = T.translation().x();
  pose.position.y = T.translation().y();
  pose.position.z = T.translation().z();
  pose.orientation.x = T.unitQuaternion().x();
  pose.orientation.y = T.unitQuaternion().y();
  pose.orientation.z = T.unitQuaternion().z();
  pose.orientation.w = T.unitQuaternion().w();
  return pose;
}

std::array<double, 36> covarianceOf(const dsorb::SE3& T_world_cam,
                                    const dsorb::Matrix6d& covariance) {
  // T_world_cam exp(-xi): the increment acts in the axes of the camera.
  Eigen::Matrix<double, 6, 6> turn = Eigen::Matrix<double, 6, 6>::Zero();
  turn.topLeftCorner<3, 3>() = T_world_cam.rotationMatrix();
  turn.bottomRightCorner<3, 3>() = T_world_cam.rotationMatrix();
  std::array<double, 36> values{};
  Eigen::Map<Eigen::Matrix<double, 6, 6, Eigen::RowMajor>>(values.data()) =
      turn * covariance * turn.transpose();
  return values;
}

sensor_msgs::msg::PointCloud2 cloudOf(const std::vector<dsorb::KeyframeSnapshot>& keyframes,
                                      const dsorb::SE3& T_odom_world) {
  sensor_msgs::msg::PointCloud2 cloud;
  cloud.height = 1;
  for (const char* name : {"x", "y", "z", "intensity"}) addField(cloud, name);
  for (const dsorb::KeyframeSnapshot& keyframe : keyframes) {
    const dsorb::SE3 T_odom_cam = T_odom_world * keyframe.T_world_cam;
    for (const dsorb::MapPoint& point : keyframe.points) {
      const double inverse_depth = point.inverse_depth;
      if (!(std::sqrt(point.variance) < kMostUncertain * inverse_depth)) continue;
      const Eigen::Vector3d ray = keyframe.camera.unproject(point.pixel.template cast<double>());
      addPoint(cloud, T_odom_cam * (ray / inverse_depth), static_cast<float>(point.intensity));
    }
  }
  cloud.row_step = cloud.width * cloud.point_step;
  cloud.is_dense = true;
  return cloud;
}

}  // namespace dsorb_ros
