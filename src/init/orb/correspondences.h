// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/frame.h"
#include "dsorb/options/orb.h"

#include "init/orb/map/reference_view.h"
#include "init/orb/tracks/feature_matches.h"
#include "init/orb/tracks/feature_tracks.h"

#include <vector>

namespace dsorb::init_orb {

/// Points of a reference frame and where the frames after it show them: ORB features matched by
/// their descriptors; from the first frame on that has too few of these, corners followed by
/// optical flow instead, through all frames since the reference.
class Correspondences {
 public:
  explicit Correspondences(const OrbOptions& options);

  void start(FramePtr reference);
  void advance(FramePtr frame);
  void clear();

  /// Since the reference, which counts.
  [[nodiscard]] int frames() const { return static_cast<int>(frames_.size()); }
  /// Points of the reference that the newest frame shows.
  [[nodiscard]] int size() const;
  /// Whether too little of the reference is left, or a cut ended it.
  [[nodiscard]] bool lost() const;
  [[nodiscard]] bool usesFlow() const { return uses_flow_; }
  /// All frames; the points that the newest one shows.
  [[nodiscard]] ReferenceView view() const;

 private:
  void changeToFlow();

  OrbOptions options_;
  FeatureMatches matches_;
  FeatureTracks tracks_;
  bool uses_flow_ = false;
  std::vector<FramePtr> frames_;
  std::vector<std::vector<Eigen::Vector2f>> sightings_;  // of the features, one a frame [px]
};

}  // namespace dsorb::init_orb
