// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/frame.h"
#include "dsorb/options/orb.h"

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include <vector>

namespace dsorb::init_orb {

/// Corners of a reference image followed from frame to frame with Lucas-Kanade; a track must come
/// back to where it started when it is followed backwards. Only tracks that live in every frame
/// since the reference are kept.
/// @source Bouguet, Pyramidal Implementation of the Lucas Kanade Feature Tracker; Shi and Tomasi,
///         Good Features to Track, CVPR 1994
class FeatureTracks {
 public:
  explicit FeatureTracks(const FeatureTrackOptions& options) : options_(options) {}

  /// Forgets everything and finds the corners of a new reference.
  void start(const Frame& reference);
  /// Follows all live tracks into the next frame, which has the reference's size.
  void advance(const Frame& frame);
  void clear();

  /// Live tracks.
  [[nodiscard]] int size() const {
    return positions_.empty() ? 0 : static_cast<int>(positions_.front().size());
  }
  /// Frames since the reference, the reference included.
  [[nodiscard]] int frames() const { return static_cast<int>(positions_.size()); }
  /// Share of the tracks that survived the last step; 1 for a reference.
  [[nodiscard]] double survivorShare() const { return survivor_share_; }
  /// Positions of all live tracks in one frame [px]; entry i is the same corner in every frame.
  [[nodiscard]] const std::vector<Eigen::Vector2f>& positions(int frame) const {
    return positions_[static_cast<std::size_t>(frame)];
  }

 private:
  void keepOnly(const std::vector<char>& alive);

  FeatureTrackOptions options_;
  std::vector<std::vector<Eigen::Vector2f>> positions_;  // [frame][track]
  std::vector<cv::Mat> previous_pyramid_;                // Lucas-Kanade's own, with derivatives
  double survivor_share_ = 1;
  double reference_mean_ = 0;  // intensity that later images are brought to [grey levels]
};

}  // namespace dsorb::init_orb
