// SPDX-License-Identifier: BSD-3-Clause
// Starts with what the caller knows: a depth camera, a LiDAR, a network, a gyroscope, wheels.
#include "images.h"

#include <dsorb/image/frame_priors.h>
#include <dsorb/init/initializer.h>
#include <dsorb/init/metric_scale.h>

#include <cstdio>
#include <functional>
#include <memory>

namespace {

/// Stands for a depth camera, or a network: every pixel, 1 % too long or too short.
std::vector<float> grabDepth(int i, double unit = 1) {
  std::vector<float> image;
  image.reserve(static_cast<std::size_t>(kWidth) * kHeight);
  for (int v = 0; v < kHeight; ++v) {
    for (int u = 0; u < kWidth; ++u) {
      const double error = (u * 31 + v * 17) % 2 == 0 ? 1.01 : 0.99;
      image.push_back(static_cast<float>(depth(u, v, i) * error / unit));
    }
  }
  return image;
}

/// Stands for LiDAR returns projected into the image: rows far apart, points close together.
std::vector<dsorb::DepthAtPixel> grabLidar(int i) {
  std::vector<dsorb::DepthAtPixel> points;
  for (int v = 2; v < kHeight; v += 6) {
    for (int u = 0; u < kWidth; u += 3) {
      const auto metres = static_cast<float>(depth(u, v, i));
      points.push_back({static_cast<float>(u), static_cast<float>(v), metres, .02F});
    }
  }
  return points;
}

using MakeFrame = std::function<dsorb::FramePtr(dsorb::ImageView, int)>;

dsorb::FramePtr withDepthCamera(dsorb::ImageView image, int i) {
  dsorb::FrameInfo info{dsorb::FrameId{i}, i / 30.0};
  // [dense]
  const std::vector<float> depth = grabDepth(i);  // metres; NaN or 0 where there is none
  auto priors = std::make_shared<dsorb::FramePriors>();
  priors->depth = dsorb::denseDepth({depth.data(), kWidth, kHeight}, 0, .01);
  info.priors = priors;
  auto frame = dsorb::Frame::create(image, info);
  // [/dense]
  return frame;
}

dsorb::FramePtr withLidar(dsorb::ImageView image, int i) {
  dsorb::FrameInfo info{dsorb::FrameId{i}, i / 30.0};
  // [sparse]
  const std::vector<dsorb::DepthAtPixel> points = grabLidar(i);  // x, y, depth, sigma
  auto priors = std::make_shared<dsorb::FramePriors>();
  priors->depth = dsorb::sparseDepth(kWidth, kHeight, points);
  // [/sparse]
  info.priors = priors;
  return dsorb::Frame::create(image, info);
}

dsorb::FramePtr withNetwork(dsorb::ImageView image, int i) {
  dsorb::FrameInfo info{dsorb::FrameId{i}, i / 30.0};
  constexpr double kNobodyKnows = 2.7;  // metres of the network's unit
  const std::vector<float> depth = grabDepth(i, kNobodyKnows);
  auto priors = std::make_shared<dsorb::FramePriors>();
  // [network]
  priors->depth = dsorb::denseDepth({depth.data(), kWidth, kHeight}, 0, .05);
  priors->depth->metric = false;  // right but for one factor
  // [/network]
  info.priors = priors;
  return dsorb::Frame::create(image, info);
}

/// Stands for the integrated rates of a gyroscope: this camera does not turn.
Eigen::Matrix3d integrateGyroscope(int /*from*/, int /*to*/) {
  return Eigen::Matrix3d::Identity();
}

dsorb::FramePtr withGyroscope(dsorb::ImageView image, int i) {
  dsorb::FrameInfo info{dsorb::FrameId{i}, i / 30.0};
  auto priors = std::make_shared<dsorb::FramePriors>();
  // [gyroscope]
  if (i > 0) {
    const Eigen::Matrix3d R = integrateGyroscope(i - 1, i);  // directions of frame i - 1 to i
    priors->pose = dsorb::rotationSince(dsorb::FrameId{i - 1}, R, .0005);
  }
  // [/gyroscope]
  info.priors = priors;
  return dsorb::Frame::create(image, info);
}

dsorb::FramePtr withWheels(dsorb::ImageView image, int i) {
  dsorb::FrameInfo info{dsorb::FrameId{i}, i / 30.0};
  auto priors = std::make_shared<dsorb::FramePriors>();
  if (i > 0) {
    const double metres = std::hypot(cameraX(i) - cameraX(i - 1), cameraZ(i) - cameraZ(i - 1));
    // [wheels]
    priors->distance = dsorb::DistancePrior{dsorb::FrameId{i - 1}, metres, .002};
    // [/wheels]
  }
  info.priors = priors;
  return dsorb::Frame::create(image, info);
}

dsorb::FramePtr withOdometry(dsorb::ImageView image, int i) {
  dsorb::FrameInfo info{dsorb::FrameId{i}, i / 30.0};
  auto priors = std::make_shared<dsorb::FramePriors>();
  if (i > 0) {
    const Eigen::Vector3d moved(cameraX(i - 1) - cameraX(i), 0, cameraZ(i - 1) - cameraZ(i));
    // [pose]
    const dsorb::SE3 T(integrateGyroscope(i - 1, i), moved);  // points of frame i - 1 to i [m]
    dsorb::Matrix6d covariance = dsorb::Matrix6d::Zero();
    covariance.diagonal() << 4e-6, 4e-6, 4e-6, 2.5e-7, 2.5e-7, 2.5e-7;  // [m^2], [rad^2]
    priors->pose = dsorb::poseSince(dsorb::FrameId{i - 1}, T, covariance);
    // [/pose]
  }
  info.priors = priors;
  return dsorb::Frame::create(image, info);
}

/// What became of the priors.
const char* used(const dsorb::InitReport& report) {
  return report.depth_prior.value_or(false)  ? "depths used"
         : report.pose_prior.value_or(false) ? "motions used"
                                             : "";
}

/// Starts from frames with priors. @return whether it did, early enough and in metres if expected
bool start(const char* what, const MakeFrame& make, bool metric, int frames) {
  const dsorb::PinholeCamera camera{kFocal, kFocal, kWidth / 2.0, kHeight / 2.0, kWidth, kHeight};
  const auto initializer = dsorb::makeInitializer(dsorb::InitializerOptions(), camera);
  for (int i = 0; i < 10; ++i) {
    const auto pixels = grabImage(i);
    auto step = initializer->addFrame(make({pixels.data(), kWidth, kHeight}, i));
    if (!step.result) continue;
    const dsorb::InitializationResult& result = *step.result;
    std::printf("%s: started with %d frames %s", what, i + 1, used(result.report));
    if (result.metric) {
      const double moved = std::hypot(cameraX(i), cameraZ(i));
      const double units = result.frames.back().T_cam_ref->translation().norm();
      const double found = result.metric->metres * units;
      std::printf(", the camera moved by %.4f m (true: %.4f)", found, moved);
      if (std::abs(found / moved - 1) > .05) return false;
    }
    std::puts("");
    return i < frames && result.metric.has_value() == metric;
  }
  std::printf("%s: not initialized\n", what);
  return false;
}

}  // namespace

int main() {
  bool good = start("depth camera", withDepthCamera, true, 2);
  good = start("LiDAR", withLidar, true, 3) && good;
  good = start("network", withNetwork, false, 3) && good;
  good = start("gyroscope", withGyroscope, false, 5) && good;
  good = start("wheels", withWheels, true, 10) && good;
  good = start("odometry", withOdometry, true, 10) && good;
  return good ? 0 : 1;
}
