// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/frame_priors.h"

#include <Eigen/Core>

#include <filesystem>
#include <optional>
#include <vector>

namespace dsorb {

/// Rates of turn beside a sequence, as rotations between its frames.
class Gyroscope {
 public:
  /// @param file  lines of time, wx, wy, wz and perhaps more, between commas or spaces: seconds or
  ///              nanoseconds, rad/s, as imu0/data.csv of EuRoC; lines that begin with # or a
  ///              letter are comments
  /// @param R_cam_gyro axes of the gyroscope to those of the camera (x right, y down, z forward)
  /// @throws IoError naming file and line
  Gyroscope(const std::filesystem::path& file, const Eigen::Matrix3d& R_cam_gyro);

  /// Rotation from one frame to a later or earlier one.
  /// @return nothing where the rates have a gap of .1 s, or do not reach
  [[nodiscard]] std::optional<PosePrior> between(FrameId since, double then, double now) const;

 private:
  struct Sample {
    double time;            // [s]
    Eigen::Vector3d rates;  // axes of the camera [rad/s]
  };
  std::vector<Sample> samples_;
};

/// Nine numbers, row by row, between commas or spaces. @return empty where they are no rotation
[[nodiscard]] std::optional<Eigen::Matrix3d> parseRotation(const std::string& text);

}  // namespace dsorb
