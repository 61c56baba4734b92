// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "base/lanes.h"
#include "features/lucas_kanade.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>

#include <array>
#include <cstddef>

namespace dsorb::self_calibration {

constexpr int kPatchReach = 10;  // to either side of the middle [px]
constexpr int kPatchSide = 2 * kPatchReach + 1;
constexpr int kPatchStride =
    (kPatchSide + kLanes - 1) / kLanes * kLanes;  // whole lanes; 0 behind a row

/// Where an image shows a patch of another one.
struct PatchPose {
  Eigen::Vector2f place;                                ///< of its centre [px]
  Eigen::Matrix2f shape = Eigen::Matrix2f::Identity();  ///< what a step from there becomes
};

/// Whether all of a patch lies in an image.
[[nodiscard]] bool isInside(const FlowLevel& image, const PatchPose& pose);

/// A patch of an image, found in others that stretch, turn and shear it: one that only moves ends
/// beside its corner as soon as the view changes.
/// @source Baker and Matthews, Lucas-Kanade 20 Years On, IJCV 2004 (inverse compositional)
class ShapedPatch {
 public:
  /// @param middle whole pixel; the patch lies inside
  ShapedPatch(const FlowLevel& image, const Eigen::Vector2f& middle);

  /// @param pose where the search begins; gets where it ends
  /// @return     false where it does not end, or shows something else there
  [[nodiscard]] bool align(const FlowLevel& image, PatchPose& pose) const;

 private:
  using Rows = std::array<float, static_cast<std::size_t>(kPatchSide* kPatchStride)>;
  using Vector6f = Eigen::Matrix<float, 6, 1>;
  struct Difference;

  [[nodiscard]] Difference compare(const FlowLevel& image, const PatchPose& pose) const;

  Rows value_{};
  Rows dx_{};
  Rows dy_{};
  Vector6f slopes_ = Vector6f::Zero();  // by place and shape, summed
  Eigen::LLT<Eigen::Matrix<float, 6, 6>> information_;
  float variance_ = 0;  // summed
};

}  // namespace dsorb::self_calibration
