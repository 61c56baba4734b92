// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/options/orb_mapping.h"

#include "base/random.h"
#include "init/orb/map/initial_map.h"

#include <cstddef>
#include <vector>

namespace dsorb {

/// Corners, poses and their exact or noisy observations, without images.
struct SyntheticMap {
  PinholeCamera camera{400, 410, 319.5, 239.5, 640, 480};
  init_orb::InitialMap truth;  ///< mean inverse depth 1
  init_orb::InitialMap start;  ///< the same observations, perturbed poses and inverse depths
};

/// As [Gladkova]: hardly any observation of these scenes is weighted down.
inline GeometricOptions huber() {
  GeometricOptions options;
  options.sigma = 1;
  options.loss = RobustLoss::kHuber;
  options.loss_threshold = 2.4474;
  return options;
}

struct SyntheticMapOptions {
  int corners = 300;
  int frames = 5;
  double noise = 0;         ///< of the observations [px]
  double perturbation = 0;  ///< relative, of inverse depths; poses get a tenth of it
};

/// A camera that moves sideways and forward past points at depths 2 to 8 times its path.
inline SyntheticMap makeSyntheticMap(const SyntheticMapOptions& options, std::uint64_t seed) {
  SyntheticMap scene;
  Random random(seed);
  init_orb::InitialMap& truth = scene.truth;
  double mean = 0;
  for (int i = 0; i < options.corners; ++i) {
    init_orb::Corner corner;
    corner.pixel = {random.uniform(80, 560), random.uniform(60, 420)};
    corner.inverse_depth = 1.0 / random.uniform(2, 8);
    mean += corner.inverse_depth / options.corners;
    truth.corners.push_back(corner);
  }
  const auto frames = static_cast<std::size_t>(options.frames);
  truth.frames.resize(frames);
  truth.frames.front().T_cam_ref = SE3();
  for (int k = 1; k < options.frames; ++k) {
    const double path = static_cast<double>(k) / (options.frames - 1);
    Vector6d xi;
    xi << 0.5 * path + 0.02 * random.gaussian(), 0.05 * random.gaussian(), -0.4 * path,
        0.01 * random.gaussian(), 0.03 * path, 0.01 * random.gaussian();
    SE3 pose = SE3::exp(xi);
    pose.setTranslation(pose.translation() * mean);
    truth.frames[static_cast<std::size_t>(k)].T_cam_ref = pose;
  }
  for (std::size_t i = 0; i < truth.corners.size(); ++i) {
    init_orb::Corner& corner = truth.corners[i];
    corner.inverse_depth /= mean;
    const Eigen::Vector3d point = scene.camera.unproject(corner.pixel) / corner.inverse_depth;
    for (std::size_t k = 1; k < truth.frames.size(); ++k) {
      const SE3& T = *truth.frames[k].T_cam_ref;
      const Eigen::Vector2d noise{random.gaussian(), random.gaussian()};
      truth.observations.push_back({i, k, scene.camera.project(T * point) + options.noise * noise});
    }
  }
  scene.start = truth;
  for (init_orb::Corner& corner : scene.start.corners) {
    corner.inverse_depth *= 1.0 + options.perturbation * random.uniform(-1, 1);
  }
  for (std::size_t k = 1; k < frames; ++k) {
    Vector6d xi;
    for (int d = 0; d < 6; ++d) {
      xi[d] = 0.1 * options.perturbation * random.uniform(-1, 1);
    }
    scene.start.frames[k].T_cam_ref = SE3::exp(xi) * *scene.start.frames[k].T_cam_ref;
  }
  return scene;
}

/// Adds the same error to all corners of a cell of the image, another in each frame.
/// @param sigma each axis [px]
inline void addSharedErrors(SyntheticMap& scene, double sigma, std::uint64_t seed) {
  Random random(seed);
  std::vector<Eigen::Vector2d> errors(kErrorCells * scene.start.frames.size());
  for (Eigen::Vector2d& error : errors) error = {random.gaussian(), random.gaussian()};
  for (init_orb::CornerObservation& observation : scene.start.observations) {
    const std::size_t cell = imageCell(scene.start.corners[observation.corner].pixel, scene.camera);
    observation.pixel += sigma * errors[kErrorCells * observation.frame + cell];
  }
}

}  // namespace dsorb
