// SPDX-License-Identifier: BSD-3-Clause
// Odometry started by somebody's own initializer, here one that is told the truth. It is known by
// its name: where a library brings it, `dso_dataset --initializer=known-start` and YAML find it
// too.
#include "images.h"

#include <dsorb/init/registry.h>
#include <dsorb/odometry/odometry.h>

#include <cstdio>

namespace {

class KnownStart : public dsorb::Initializer {
 public:
  explicit KnownStart(const dsorb::PinholeCamera& camera) : camera_(camera) {}

  dsorb::InitStep addFrame(dsorb::FramePtr frame) override {
    frames_.push_back({frame, poseOf(*frame), {}, std::nullopt});
    if (frames_.size() == 1) return {};
    return {dsorb::InitStatus::kInitialized, dsorb::InitReason::kDone, result()};
  }
  void reset() override { frames_.clear(); }

 private:
  static dsorb::SE3 poseOf(const dsorb::Frame& frame) {
    const int i = frame.id().value;
    return {Eigen::Quaterniond::Identity(), -Eigen::Vector3d(cameraX(i), 0, cameraZ(i))};
  }
  dsorb::InitializationResult result() const {
    dsorb::InitializationResult result;
    result.frames = frames_;
    const dsorb::PyramidLevel& image = frames_.front().frame->level(0);
    double sum = 0;
    for (int v = 8; v < kHeight - 8; v += 5) {
      for (int u = 8; u < kWidth - 8; u += 5) {
        if (std::hypot(image.at(u, v).dx, image.at(u, v).dy) < 4) continue;
        const auto inverse_depth =
            static_cast<float>(1 / depth(u, v, frames_.front().frame->id().value));
        result.points.push_back(
            {0, {u, v}, inverse_depth, 1e-4F * inverse_depth * inverse_depth, 1});
        sum += inverse_depth;
      }
    }
    const double mean =
        sum / static_cast<double>(result.points.size());  // becomes 1: the unit's definition
    for (dsorb::InitPoint& point : result.points) {
      point.inverse_depth /= static_cast<float>(mean);
      point.variance /= static_cast<float>(mean * mean);
    }
    for (dsorb::PosedFrame& posed : result.frames) {
      posed.T_cam_ref->setTranslation(posed.T_cam_ref->translation() * mean);
    }
    return result;
  }

  dsorb::PinholeCamera camera_;
  std::vector<dsorb::PosedFrame> frames_;
};

const dsorb::RegisteredInitializer kKnownStart("known-start", [](const auto&, const auto& camera) {
  return std::make_unique<KnownStart>(camera);
});

}  // namespace

int main() {
  const dsorb::PinholeCamera camera{kFocal, kFocal, kWidth / 2.0, kHeight / 2.0, kWidth, kHeight};
  dsorb::OdometryOptions options;
  options.initializer = dsorb::initializerVariant("known-start");
  dsorb::Odometry odometry(camera, options);
  Eigen::Vector3d t(0, 0, 0);
  for (int i = 0; i < 10; ++i) {
    const auto pixels = grabImage(i);
    const auto estimate = odometry.process(dsorb::Frame::create(
        dsorb::ImageView(pixels.data(), kWidth, kHeight), {dsorb::FrameId{i}, i / 30.0}));
    if (estimate.T_world_cam) t = estimate.T_world_cam->translation();
  }
  const dsorb::OdometryReport report = odometry.finish();
  const double angle = std::atan2(t.head<2>().norm(), t.z()) * 180 / 3.14159265;
  std::printf("%d frames tracked, camera moved %.2f degrees off its axis (true: 63.43)\n",
              report.frames_tracked,
              angle);
  return report.frames_tracked >= 8 && std::abs(angle - 63.43) < 0.5 ? 0 : 1;
}
