// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/semi_dense/epipolar_line.h"

namespace dsorb::init_orb {
namespace {

constexpr float kMinZ = 0.05F;      // depth in the frame over depth in the reference
constexpr float kMinSpeed = 1e-3F;  // [px unit]: no direction can be told

}  // namespace

std::optional<EpipolarLine> EpipolarLine::through(const EpipolarGeometry& geometry,
                                                  const Eigen::Vector2f& pixel,
                                                  float inverse_depth) {
  EpipolarLine line;
  line.at_infinity_ = geometry.atInfinity(pixel);
  line.b_ = geometry.b;
  const Eigen::Vector3f p = line.at_infinity_ + inverse_depth * line.b_;
  if (!(p.z() > kMinZ)) {
    return std::nullopt;
  }
  const float inverse_z = 1.0F / p.z();
  line.origin_ = p.head<2>() * inverse_z;
  const Eigen::Vector2f velocity = (line.b_.head<2>() - line.origin_ * line.b_.z()) * inverse_z;
  line.speed_ = velocity.norm();
  if (!(line.speed_ > kMinSpeed)) {
    return std::nullopt;
  }
  line.direction_ = velocity / line.speed_;
  line.warp_ =
      (geometry.A.topLeftCorner<2, 2>() - line.origin_ * geometry.A.bottomLeftCorner<1, 2>()) *
      inverse_z;
  return line;
}

std::optional<float> EpipolarLine::positionOf(float inverse_depth) const {
  const Eigen::Vector3f p = at_infinity_ + inverse_depth * b_;
  if (!(p.z() > kMinZ)) {
    return std::nullopt;
  }
  return direction_.dot(p.head<2>() / p.z() - origin_);
}

EpipolarLine::Depth EpipolarLine::depthAt(float position) const {
  // at_infinity + rho b is parallel to (pixel, 1): both rows projected on the line's direction.
  const Eigen::Vector2f pixel = at(position);
  const float numerator = direction_.dot(at_infinity_.head<2>() - pixel * at_infinity_.z());
  const float denominator = direction_.dot(pixel * b_.z() - b_.head<2>());
  return {numerator / denominator,
          -(at_infinity_.z() * denominator + numerator * b_.z()) / (denominator * denominator)};
}

}  // namespace dsorb::init_orb
