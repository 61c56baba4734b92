// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/frame.h"
#include "dsorb/options/orb.h"

#include "init/orb/reference_source.h"
#include "init/orb/tracks/feature_matches.h"
#include "init/orb/tracks/feature_tracks.h"

#include <vector>

namespace dsorb::init_orb {

/// A single reference, paired with the newest frame: ORB features matched by their descriptors;
/// from the first frame on that has too few of these, corners followed by optical flow instead,
/// through all frames since the reference. While there is too little parallax the pair grows; one
/// that fails otherwise is given up.
/// @source the variant of X. Qu, described in [Gladkova], section 4
class Correspondences final : public ReferenceSource {
 public:
  explicit Correspondences(const OrbOptions& options);

  void start(FramePtr reference) override;
  void advance(FramePtr frame) override;
  void clear() override;

  [[nodiscard]] bool empty() const override { return frames_.empty(); }
  [[nodiscard]] const Frame& newest() const override { return *frames_.back(); }
  [[nodiscard]] bool tooFewCorners() const override {
    return frames_.size() == 1 && size() < options_.min_tracked;
  }
  bool dropLost() override;
  std::optional<InitReason> giveUp(InitReason failure) override;

  [[nodiscard]] int references() const override { return 1; }
  [[nodiscard]] int age(int /*reference*/) const override {
    return static_cast<int>(frames_.size());
  }
  [[nodiscard]] ReferenceView view(int reference) const override;
  [[nodiscard]] CornerTracks newestTracks() const override { return view(0).tracks; }
  /// Points of the reference that the newest frame shows.
  [[nodiscard]] int size() const;

 private:
  void changeToFlow();

  OrbOptions options_;
  FeatureMatches matches_;
  FeatureTracks tracks_;
  bool uses_flow_ = false;
  std::vector<FramePtr> frames_;
  std::vector<std::vector<Eigen::Vector2f>> observations_;  // of the features, one a frame [px]
};

}  // namespace dsorb::init_orb
