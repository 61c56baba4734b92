// SPDX-License-Identifier: BSD-3-Clause
// Feeds another system's map: posed keyframes and points with variances, in that system's own
// types.
#include "images.h"

#include <dsorb/init/initializer.h>

#include <algorithm>
#include <cstdio>

namespace {

struct Keyframe {
  double timestamp;
  Eigen::Matrix4d camera_to_world;
};
struct Landmark {
  Eigen::Vector3d position;
  double depth_sigma;  // relative
};
struct Map {
  std::vector<Keyframe> keyframes;
  std::vector<Landmark> landmarks;
};

Map copyToMap(const dsorb::InitializationResult& result, const dsorb::PinholeCamera& camera) {
  Map map;
  for (const dsorb::PosedFrame& posed : result.frames) {
    if (!posed.T_cam_ref) continue;
    map.keyframes.push_back({posed.frame->timestamp(), posed.T_cam_ref->inverse().matrix()});
  }
  for (const dsorb::InitPoint& point : result.points) {
    const auto host = static_cast<std::size_t>(point.host);
    const Eigen::Vector3d in_host =
        camera.unproject(point.pixel.cast<double>()) / point.inverse_depth;
    map.landmarks.push_back({result.frames[host].T_cam_ref->inverse() * in_host,
                             std::sqrt(point.variance) / point.inverse_depth});
  }
  return map;
}

}  // namespace

int main() {
  const dsorb::PinholeCamera camera{kFocal, kFocal, kWidth / 2.0, kHeight / 2.0, kWidth, kHeight};
  dsorb::InitializerOptions options;
  options.num_threads = 2;
  const auto initializer = dsorb::makeInitializer(options, camera);
  for (int i = 0; i < 30; ++i) {
    const auto pixels = grabImage(i);
    const auto step = initializer->addFrame(dsorb::Frame::create(
        dsorb::ImageView(pixels.data(), kWidth, kHeight), {dsorb::FrameId{i}, i / 30.0}));
    if (!step.result) continue;

    const Map map = copyToMap(*step.result, camera);
    // The corridor's floor is at y = 1.2, in the initializer's unit.
    std::vector<double> floor;
    for (const Landmark& landmark : map.landmarks) {
      const Eigen::Vector3d& p = landmark.position;
      if (p.y() > 0.25 * p.z() && std::abs(p.x()) < 0.8 * p.y()) floor.push_back(p.y());
    }
    if (floor.size() < 20) return std::puts("too few points on the floor"), 1;
    std::sort(floor.begin(), floor.end());
    const double spread =
        (floor[floor.size() * 3 / 4] - floor[floor.size() / 4]) / floor[floor.size() / 2];
    std::printf("%zu keyframes, %zu landmarks; the floor is flat within %.1f %%\n",
                map.keyframes.size(),
                map.landmarks.size(),
                100 * spread);
    return map.keyframes.size() >= 2 && spread < 0.1 ? 0 : 1;
  }
  return std::puts("not initialized"), 1;
}
