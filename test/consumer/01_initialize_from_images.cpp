// SPDX-License-Identifier: BSD-3-Clause
// Poses and depths of the first frames from raw grey pointers.
#include "images.h"

#include <dsorb/init/initializer.h>

#include <cstdio>

int main() {
  const dsorb::PinholeCamera camera{kFocal, kFocal, kWidth / 2.0, kHeight / 2.0, kWidth, kHeight};
  const auto initializer = dsorb::makeInitializer(dsorb::InitializerOptions(), camera);
  for (int i = 0; i < 30; ++i) {
    const auto pixels = grabImage(i);
    const dsorb::ImageView view(pixels.data(), kWidth, kHeight);
    const auto step =
        initializer->addFrame(dsorb::Frame::create(view, {dsorb::FrameId{i}, i / 30.0}));
    if (!step.result) continue;
    const Eigen::Vector3d t = step.result->frames.back().T_cam_ref->inverse().translation();
    const double angle = std::atan2(t.head<2>().norm(), t.z()) * 180 / 3.14159265;
    std::printf(
        "initialized with frame %d: %zu points, camera moved %.1f degrees off its axis (true: "
        "63.4)\n",
        i,
        step.result->points.size(),
        angle);
    return std::abs(angle - 63.4) < 2 ? 0 : 1;
  }
  std::puts("not initialized");
  return 1;
}
