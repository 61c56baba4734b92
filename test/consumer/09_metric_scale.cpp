// SPDX-License-Identifier: BSD-3-Clause
// A start in metres: by depths at its reference, and by a known distance.
#include "images.h"

#include <dsorb/init/initializer.h>
#include <dsorb/init/metric_scale.h>

#include <cstdio>

namespace {

/// Stands for a depth camera: every other pixel of a row, 3 % too long or 2 % too short.
std::vector<float> grabDepth(int i) {
  std::vector<float> image(static_cast<std::size_t>(kWidth) * kHeight, 0.F);
  for (int v = 0; v < kHeight; ++v) {
    for (int u = (v * 7) % 4; u < kWidth; u += 2) {
      const double error = (u * 31 + v * 17) % 5 < 2 ? 1.03 : 0.98;
      image[static_cast<std::size_t>(v) * kWidth + u] = static_cast<float>(depth(u, v, i) * error);
    }
  }
  return image;
}

double moved(int from, int to) {
  return std::hypot(cameraX(to) - cameraX(from), cameraZ(to) - cameraZ(from));
}

/// Compares with the truth by poses. @return whether it is within 3 % (1.2; by distance 0, as made)
bool report(const char* what, const std::optional<dsorb::MetricScale>& scale, double truth) {
  if (!scale) return false;
  std::printf("%s: a unit is %.4f m (true: %.4f), sigma %.2f %%\n",
              what,
              scale->metres,
              truth,
              100 * scale->relative_sigma);
  return std::abs(scale->metres / truth - 1) < .03;
}

}  // namespace

int main() {
  const dsorb::PinholeCamera camera{kFocal, kFocal, kWidth / 2.0, kHeight / 2.0, kWidth, kHeight};
  const auto initializer = dsorb::makeInitializer(dsorb::InitializerOptions(), camera);
  for (int i = 0; i < 30; ++i) {
    const auto pixels = grabImage(i);
    const dsorb::ImageView view(pixels.data(), kWidth, kHeight);
    auto step = initializer->addFrame(dsorb::Frame::create(view, {dsorb::FrameId{i}, i / 30.0}));
    if (!step.result) continue;
    dsorb::InitializationResult& result = *step.result;
    const int reference = result.frames.front().frame->id().value;
    const double metres = moved(reference, i);
    const double truth = metres / result.frames.back().T_cam_ref->translation().norm();
    // [scale]
    const auto depths = grabDepth(reference);  // NaN or 0 where it is not known
    const dsorb::ImageView depth_view(depths.data(), kWidth, kHeight);
    const auto by_depth = dsorb::scaleFromDepth(result, {depth_view, 0, .03});
    const auto by_distance = dsorb::scaleFromDistance(result, {dsorb::FrameId{i}, metres, .001});
    if (by_depth) dsorb::toMetres(*by_depth, result);
    // [/scale]
    const bool good = report("depth", by_depth, truth);
    return report("distance", by_distance, truth) && good ? 0 : 1;
  }
  std::puts("not initialized");
  return 1;
}
