// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/result.h"

#include <Eigen/Geometry>

#include <cstddef>
#include <string>
#include <utility>
#include <vector>

namespace dsorb {

/// All positions turned about the reference, across the direction of motion: rotations, depths and
/// variances stay.
inline InitializationResult turned(InitializationResult start, double degrees) {
  constexpr double kRadians = 3.14159265358979323846 / 180.0;
  const SE3 newest = start.frames.back().T_cam_ref->inverse();
  const Eigen::Vector3d axis = newest.translation().unitOrthogonal();
  const Eigen::Matrix3d turn = Eigen::AngleAxisd(degrees * kRadians, axis).toRotationMatrix();
  for (std::size_t i = 1; i < start.frames.size(); ++i) {
    if (!start.frames[i].T_cam_ref) continue;
    SE3& T_cam_ref = *start.frames[i].T_cam_ref;
    const Eigen::Vector3d position = T_cam_ref.inverse().translation();
    T_cam_ref.setTranslation(-(T_cam_ref.rotationMatrix() * (turn * position)));
  }
  return start;
}

/// Near and far exchanged: every depth in place of its inverse, the relative variances stay.
inline InitializationResult exchanged(InitializationResult start) {
  double sum = 0;
  double hosted = 0;
  for (InitPoint& point : start.points) {
    const float squared = point.inverse_depth * point.inverse_depth;
    point.variance /= squared * squared;
    point.inverse_depth = 1 / point.inverse_depth;
    if (point.host != 0) continue;
    sum += static_cast<double>(point.inverse_depth);
    ++hosted;
  }
  const auto unit = static_cast<float>(hosted / sum);  // the mean stays 1
  for (InitPoint& point : start.points) {
    point.inverse_depth *= unit;
    point.variance *= unit * unit;
  }
  return start;
}

/// Every second point at half its depth.
inline InitializationResult halfDoubled(InitializationResult start) {
  for (std::size_t i = 0; i < start.points.size(); i += 2) {
    start.points[i].inverse_depth *= 2;
    start.points[i].variance *= 4;
  }
  return start;
}

/// A start as it is and wrong in every way above, each with its name.
inline std::vector<std::pair<std::string, InitializationResult>> withWrongOnes(
    const InitializationResult& start) {
  return {{"right", start},
          {"turned20", turned(start, 20)},
          {"turned40", turned(start, 40)},
          {"turned90", turned(start, 90)},
          {"exchanged", exchanged(start)},
          {"half_doubled", halfDoubled(start)}};
}

}  // namespace dsorb
