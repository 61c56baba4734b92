// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/frame.h"

#include "features/pose_from_matches.h"
#include "track/tracking_reference.h"

#include <cstdint>
#include <optional>
#include <vector>

namespace dsorb::odometry {

/// A pose of a frame, and the matches with the keyframe that tell it.
struct MatchEvidence {
  std::vector<PointObservation> matches;
  MatchedPose pose;
};

/// Poses that matched corners of a frame and its keyframe tell, however far apart both are. The
/// corners of both are looked for when they are asked for.
class MatchedPoses {
 public:
  explicit MatchedPoses(std::uint64_t seed) : seed_(seed) {}

  /// Relative to the frame of a reference. @return nullopt where too few matches agree
  [[nodiscard]] std::optional<MatchEvidence> find(const FramePtr& frame,
                                                  const track::TrackingReference& reference);

 private:
  std::uint64_t seed_;
  FramePtr host_frame_;     // of the reference
  DescribedPoints points_;  // of the reference
  double mean_ = 0;         // intensity of the reference [grey levels]
  FramePtr frame_;          // asked for last
  DescribedFrame described_{};
};

}  // namespace dsorb::odometry
