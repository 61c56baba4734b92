// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/geometry/se3.h"
#include "dsorb/image/affine_brightness.h"

#include "track/tracking_reference.h"

#include <limits>
#include <optional>
#include <vector>

namespace dsorb::track {

/// Grey levels of the reference's points and of the places where a frame sees them, compared as
/// distributions: the n-th smallest here with the n-th smallest there. Unlike differences point by
/// point that hardly depends on the pose, so a guess of it is enough.
class GreyComparison {
 public:
  /// @param T_cur_ref roughly
  GreyComparison(const TrackingReference& reference, const Frame& frame, const SE3& T_cur_ref);

  /// Gain and offset that map one distribution to the other where neither is clipped.
  /// @return nullopt where too little is left or its contrast is too low
  [[nodiscard]] std::optional<BrightnessTransfer> transfer() const;
  /// Root mean square by which a transfer misses the frame's distribution, over its standard
  /// deviation; with a wrong gain about the relative error of that [-]. Infinite without contrast.
  [[nodiscard]] double misfit(const BrightnessTransfer& transfer) const;
  /// Grey level at which the frame is clipped; infinite where it is not.
  [[nodiscard]] float ceiling() const { return ceiling_; }

 private:
  std::vector<float> reference_;  // sorted
  std::vector<float> frame_;      // sorted
  float ceiling_ = std::numeric_limits<float>::infinity();
};

}  // namespace dsorb::track
