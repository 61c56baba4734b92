// SPDX-License-Identifier: BSD-3-Clause
// The direct system of direct_system.h, from its first image on.
#include "direct_system.h"
#include "images.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace {

using direct::ActivePoint;
using direct::DirectSystem;
using direct::rehost;

/// Moves points from the reference to the newest frame and back: pixel and inverse depth return,
/// the variance too.
double worstRoundTrip(const DirectSystem& system, const dsorb::PinholeCamera& camera) {
  const dsorb::SE3 T = system.keyframes().back().T_cam_world;
  double worst = 0;
  for (const ActivePoint& p : system.points()) {
    if (p.host != 0) continue;
    const auto there = rehost(
        {0, p.pixel.cast<float>(), static_cast<float>(p.inverse_depth), 1e-4F, 1}, T, camera);
    if (!there) continue;
    const auto back = rehost({0,
                              there->pixel.cast<float>(),
                              static_cast<float>(there->inverse_depth),
                              static_cast<float>(there->variance),
                              1},
                             T.inverse(),
                             camera);
    if (!back) continue;
    worst = std::max({worst,
                      std::abs(back->inverse_depth / p.inverse_depth - 1),
                      std::abs(back->variance / 1e-4 - 1)});
  }
  return worst;
}

}  // namespace

int main() {
  const dsorb::PinholeCamera camera{kFocal, kFocal, kWidth / 2.0, kHeight / 2.0, kWidth, kHeight};
  DirectSystem system(camera);
  constexpr int kFrames = 30;
  int start = -1;
  for (int i = 0; i < kFrames; ++i) {
    const auto pixels = grabImage(i);
    system.addActiveFrame(dsorb::Frame::create(dsorb::ImageView(pixels.data(), kWidth, kHeight),
                                               {dsorb::FrameId{i}, i / 30.0}));
    if (start < 0 && !system.keyframes().empty()) start = i;
  }
  if (start < 0) return std::puts("not initialized"), 1;

  // The true path is straight and even: the last position over that of the start is known.
  const auto& path = system.trajectory();
  const Eigen::Vector3d end = path.back().T_cam_world.inverse().translation();
  const Eigen::Vector3d begin = system.keyframes().back().T_cam_world.inverse().translation();
  const double first = std::lround(path.front().timestamp * 30);
  const double ratio = end.norm() / begin.norm() * (start - first) / (kFrames - 1 - first);
  const double angle = std::atan2(end.head<2>().norm(), end.z()) * 180 / 3.14159265;
  const double round_trip = worstRoundTrip(system, camera);
  std::printf(
      "started at image %d with %zu points; %zu posed; %.2f degrees off the axis (true: 63.43), "
      "length %.4f of the "
      "true one, residual %.2f grey levels, round trip %.1e\n",
      start,
      system.points().size(),
      path.size(),
      angle,
      ratio,
      system.trackingRms(),
      round_trip);
  return std::abs(angle - 63.43) < 1 && std::abs(ratio - 1) < 0.02 && round_trip < 1e-3 ? 0 : 1;
}
