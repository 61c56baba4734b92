// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "base/random.h"
#include "synthetic/places.h"

#include <utility>

namespace dsorb::synthetic {

/// Middle of the underside of an upright box, its size and its turn about the vertical.
struct Placement {
  Eigen::Vector3d foot{0, 0, 0};  ///< world, y down [m]
  Eigen::Vector3d size{1, 1, 1};  ///< x, height, z [m]
  double heading = 0;             ///< [rad], from z towards x
};

/// Adds textures and upright boxes to a scene; randomness comes from one generator.
class PlaceBuilder {
 public:
  explicit PlaceBuilder(std::uint64_t seed) : random_(seed) {}

  Random& random() { return random_; }
  Scene& scene() { return scene_; }
  double uniform(double low, double high) { return random_.uniform(low, high); }
  float uniformFloat(double low, double high) { return static_cast<float>(uniform(low, high)); }

  /// Texture with a seed of its own and `octaves` of noise from `coarsest` [m] on.
  Texture texture(double grey, double coarsest, double amplitude, int octaves) {
    Texture made;
    made.seed = static_cast<std::uint32_t>(random_.next());
    made.grey = static_cast<float>(grey);
    const auto cell = static_cast<float>(coarsest);
    addOctaves(made, {cell, cell, static_cast<float>(amplitude)}, octaves);
    return made;
  }

  int add(Texture texture) {
    scene_.textures.push_back(std::move(texture));
    return static_cast<int>(scene_.textures.size()) - 1;
  }

  void add(const Placement& place, int texture) {
    const Eigen::Vector3d middle = place.foot - Eigen::Vector3d(0, 0.5 * place.size.y(), 0);
    scene_.boxes.push_back({uprightPose(middle, place.heading), 0.5 * place.size, texture, false});
  }

  Scene take() { return std::move(scene_); }

 private:
  Random random_;
  Scene scene_;
};

}  // namespace dsorb::synthetic
