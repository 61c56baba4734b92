// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/frame.h"

#include "features/lucas_kanade.h"
#include "self_calibration/shaped_patch.h"

#include <Eigen/Core>

#include <memory>
#include <vector>

namespace dsorb::self_calibration {

/// A corner in an image.
struct Sighting {
  int corner = 0;            ///< number, never reused
  Eigen::Vector2f pixel;     ///< [px]
  Eigen::Vector2f velocity;  ///< since the image before; 0 where it was not seen there [px/s]
};

/// Corners followed from image to image. Each is aligned with the image that it was found in, so
/// that steps do not add up their errors.
class CornerPaths {
 public:
  /// @return the corners of the next image, in the order of their numbers
  [[nodiscard]] std::vector<Sighting> add(const Frame& frame);
  /// The next image shows other corners.
  void clear();

 private:
  struct Path {
    int corner = 0;
    std::unique_ptr<const ShapedPatch> patch;  ///< of the image that it was found in
    Eigen::Vector2f place;                     ///< in the newest image [px]
    Eigen::Vector2f velocity = Eigen::Vector2f::Zero();
    Eigen::Matrix2f shape = Eigen::Matrix2f::Identity();  ///< what a step there becomes
  };
  /// Follows all paths into the newest image. @return by path, whether it goes on
  [[nodiscard]] std::vector<char> follow(double interval);
  void find(const Frame& frame, float gain);

  std::vector<Path> paths_;
  FlowPyramid newest_;
  FlowPyramid before_;
  double time_ = 0;
  double mean_ = 0;  // intensity that images are brought to; 0: the next one tells [grey levels]
  int next_ = 0;
};

}  // namespace dsorb::self_calibration
