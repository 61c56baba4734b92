// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "estimate/epipolar_geometry.h"

#include <Eigen/Core>

#include <optional>

namespace dsorb::init_orb {

/// Epipolar line of one reference pixel. Positions along it are pixels from `origin`, growing with
/// the inverse depth.
class EpipolarLine {
 public:
  /// @param pixel         in the reference
  /// @param inverse_depth where `origin` and the warp are taken [1/unit]
  /// @return nullopt behind the camera or where the line has no direction (at the epipole)
  static std::optional<EpipolarLine> through(const EpipolarGeometry& geometry,
                                             const Eigen::Vector2f& pixel,
                                             float inverse_depth);

  [[nodiscard]] const Eigen::Vector2f& origin() const { return origin_; }
  [[nodiscard]] const Eigen::Vector2f& direction() const { return direction_; }
  /// d pixel / d reference pixel at the inverse depth of `origin`, which is held constant.
  [[nodiscard]] const Eigen::Matrix2f& warp() const { return warp_; }
  /// d position / d inverse depth at `origin` [px unit].
  [[nodiscard]] float speed() const { return speed_; }

  [[nodiscard]] Eigen::Vector2f at(float position) const { return origin_ + position * direction_; }
  /// Position of an inverse depth [px]; nullopt behind the camera.
  [[nodiscard]] std::optional<float> positionOf(float inverse_depth) const;
  /// Inverse depth at a position and its derivative there.
  struct Depth {
    float inverse_depth;  ///< [1/unit]
    float alpha;          ///< d inverse depth / d position [1/(unit px)]
  };
  [[nodiscard]] Depth depthAt(float position) const;

 private:
  EpipolarLine() = default;

  Eigen::Vector3f at_infinity_{0, 0, 1};  ///< A (x, y, 1)
  Eigen::Vector3f b_{0, 0, 0};
  Eigen::Vector2f origin_{0, 0};
  Eigen::Vector2f direction_{1, 0};
  Eigen::Matrix2f warp_ = Eigen::Matrix2f::Identity();
  float speed_ = 0;
};

}  // namespace dsorb::init_orb
