// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "init/orb/map/initial_map.h"
#include "support/plane_scene.h"

#include <cmath>
#include <vector>

namespace dsorb {

/// A plane seen in later frames with other brightness, true poses and depths, and a perturbed copy.
struct PhotometricMap {
  PlaneScene scene;
  init_orb::InitialMap truth;
  init_orb::InitialMap start;  ///< the same images; poses, depths and brightness off

  struct Options {
    double noise = 0;                 ///< [grey levels]
    double depth_error = 0.05;        ///< relative, uniform
    double rotation_error = 1e-3;     ///< [rad]
    double translation_error = 0.01;  ///< of the longest translation
    bool brightness_changes = true;
  };

  PhotometricMap(std::uint64_t seed, const Options& options) : scene(seed) {
    const std::vector<Eigen::Vector3d> path = {
        {0, 0, 0}, {0.06, 0.01, 0.02}, {0.13, 0.02, 0.05}, {0.2, 0.04, 0.07}};
    const std::vector<AffineBrightness> brightness = {{}, {0.05, 2}, {-0.1, 6}, {0.15, -8}};
    for (std::size_t k = 0; k < path.size(); ++k) {
      Vector6d xi;
      const double turn = 0.01 * static_cast<double>(k);
      xi << path[k], turn, -turn, 0.5 * turn;
      const AffineBrightness affine =
          options.brightness_changes ? brightness[k] : AffineBrightness();
      const SE3 pose = SE3::exp(xi);
      const BrightnessTransfer change{std::exp(affine.a), affine.b};
      truth.frames.push_back(
          {scene.render(pose, options.noise, static_cast<int>(k), change), pose, affine, {}});
    }
    for (int y = 12; y < 228; y += 9) {
      for (int x = 12; x < 308; x += 9) {
        const double rho = scene.inverseDepth({x, y});
        if ((x / 9 + y / 9) % 4 == 0) {
          truth.corners.push_back(
              {{x + 0.3, y - 0.4}, scene.inverseDepth({x + 0.3, y - 0.4}), 1e-4});
        } else {
          truth.points.push_back(
              {{static_cast<float>(x), static_cast<float>(y)}, static_cast<float>(rho), 1e-4F, 3});
        }
      }
    }
    perturb(options, seed);
  }

  /// Scale-free relative errors of the inverse depths.
  [[nodiscard]] std::vector<double> depthErrors(const init_orb::InitialMap& map) const {
    std::vector<double> ratios;
    for (std::size_t i = 0; i < map.corners.size(); ++i) {
      ratios.push_back(map.corners[i].inverse_depth / scene.inverseDepth(map.corners[i].pixel));
    }
    for (const init_orb::SemiDensePoint& point : map.points) {
      ratios.push_back(static_cast<double>(point.inverse_depth) /
                       scene.inverseDepth(point.pixel.cast<double>()));
    }
    std::vector<double> sorted = ratios;
    std::sort(sorted.begin(), sorted.end());
    for (double& ratio : ratios) ratio = std::abs(ratio / sorted[sorted.size() / 2] - 1);
    return ratios;
  }

 private:
  void perturb(const Options& options, std::uint64_t seed) {
    start = truth;
    Random random(seed + 77);
    for (std::size_t k = 1; k < start.frames.size(); ++k) {
      Vector6d xi;
      for (int d = 0; d < 6; ++d) {
        xi[d] = random.uniform(-1, 1) *
                (d < 3 ? 0.2 * options.translation_error : options.rotation_error);
      }
      start.frames[k].T_cam_ref = SE3::exp(xi) * *truth.frames[k].T_cam_ref;
      start.frames[k].affine.a += options.brightness_changes ? 0.02 * random.uniform(-1, 1) : 0;
    }
    for (init_orb::Corner& corner : start.corners) {
      corner.inverse_depth *= 1 + options.depth_error * random.uniform(-1, 1);
    }
    for (init_orb::SemiDensePoint& point : start.points) {
      point.inverse_depth *= static_cast<float>(1 + options.depth_error * random.uniform(-1, 1));
    }
  }
};

}  // namespace dsorb
