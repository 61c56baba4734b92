// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"

#include "base/random.h"
#include "features/corner_tracks.h"

#include <cstdint>
#include <vector>

namespace dsorb {

/// Points seen by two cameras, without images.
struct TwoViewScene {
  PinholeCamera camera{450, 450, 319.5, 239.5, 640, 480};
  SE3 T_cur_ref;
  Matches matches;
  std::vector<double> inverse_depth;  ///< in the reference
};

struct TwoViewSceneOptions {
  int points = 300;
  bool plane = false;  ///< all points on one tilted plane, else at depths from 4 to 12
  Eigen::Vector3d translation{0.6, 0.1, 0.3};
  double noise = 0;          ///< of the target's pixels [px]
  double outlier_share = 0;  ///< of matches moved anywhere in the image
};

inline TwoViewScene makeTwoViewScene(const TwoViewSceneOptions& options, std::uint64_t seed) {
  TwoViewScene scene;
  Random random(seed);
  scene.T_cur_ref = SE3(so3Exp({0.02, -0.05, 0.03}), options.translation);
  const Eigen::Vector3d plane_normal(0.25, -0.15, 1);
  while (static_cast<int>(scene.matches.size()) < options.points) {
    const Eigen::Vector2d pixel{random.uniform(5, 635), random.uniform(5, 475)};
    const Eigen::Vector3d ray = scene.camera.unproject(pixel);
    const double depth =
        options.plane ? 6 / plane_normal.dot(ray) : 1 / random.uniform(1.0 / 12, 1.0 / 4);
    Eigen::Vector2d target = scene.camera.project(scene.T_cur_ref * (depth * ray));
    if (!scene.camera.contains(target)) continue;
    target += options.noise * Eigen::Vector2d{random.gaussian(), random.gaussian()};
    if (random.uniform() < options.outlier_share) {
      target = {random.uniform(5, 635), random.uniform(5, 475)};
    }
    scene.matches.reference.push_back(pixel);
    scene.matches.target.push_back(target);
    scene.inverse_depth.push_back(1 / depth);
  }
  return scene;
}

}  // namespace dsorb
