// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"

#include "estimate/target_image.h"
#include "init/orb/map/initial_map.h"

#include <array>
#include <cstddef>
#include <optional>

namespace dsorb::init_orb {

constexpr int kPatchSide = 5;
constexpr int kPatchStep = 2;  ///< [px] between two samples
constexpr std::size_t kPatchPixels = std::size_t{kPatchSide} * kPatchSide;
constexpr std::size_t kPatchLanes = 32;  ///< pixels filled up to whole lanes

/// Grey values of the reference around a corner.
using CornerPatch = std::array<float, kPatchLanes>;

/// @return nullopt where the patch leaves the image or touches an invalid pixel
std::optional<CornerPatch> cutCornerPatch(const PyramidLevel& reference,
                                          const Eigen::Vector2f& pixel);

/// Measurement of a corner by its patch in one frame.
struct Measurement {
  Eigen::Vector2d pixel{0, 0};
  Eigen::Matrix2d information = Eigen::Matrix2d::Zero();  ///< for a squared noise of a pixel of 1
  double weighted_square = 0;                             ///< sum of w r^2, w Huber's weight
  double weight = 0;                                      ///< sum of w
  double mean_residual = 0;                               ///< of |r| [grey levels]
};

/// Measures corners in one frame: aligns their patches, warped by pose and inverse depth.
class FrameMeasurer {
 public:
  FrameMeasurer(const InitialMap& map,
                const PinholeCamera& camera,
                std::size_t frame,
                const SE3& T_cam_ref);

  /// One damped Gauss-Newton step from the corner's projection.
  /// @return nullopt where the patch leaves the image or is invalid
  [[nodiscard]] std::optional<Measurement> measure(const Corner& corner,
                                                   const std::optional<CornerPatch>& patch) const;

 private:
  const PinholeCamera& camera_;
  SE3 T_cam_ref_;
  TargetImage target_;
};

}  // namespace dsorb::init_orb
