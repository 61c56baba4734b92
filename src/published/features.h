// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/frame.h"

#include "features/corner_tracks.h"
#include "features/feature_matches.h"
#include "features/grey_image.h"

#include <Eigen/Core>

#include <vector>

namespace dsorb::published {

/// The reference with all frames since, and where they show its points: corners by
/// cv::goodFeaturesToTrack, followed from frame to frame by cv::calcOpticalFlowPyrLK and back
/// again; or ORB features, matched with the reference's by their descriptors. From the first frame
/// on that has too few of these, corners are followed instead, through all frames since the
/// reference.
/// @source [Gladkova], section 3.1; descriptors: the variant of X. Qu, described in section 4
class Features {
 public:
  Features(int max_corners, bool descriptors);

  /// Forgets everything; the frame becomes the reference.
  void start(FramePtr reference);
  /// Finds the reference's points in the next frame, which has its size. @return how many
  int track(FramePtr frame);
  /// Forgets frames between the reference and the newest one beyond a budget [MiB].
  void keepWithin(int budget_mb);

  /// The reference first.
  [[nodiscard]] const std::vector<FramePtr>& frames() const { return frames_; }
  /// Number of the reference's points that the newest frame shows.
  [[nodiscard]] int size() const;
  /// Whether most tracks ended with the last step: the scene was cut.
  [[nodiscard]] bool cut() const;
  [[nodiscard]] bool usesFlow() const { return uses_flow_; }
  /// Places in all frames of the points that the newest one shows.
  [[nodiscard]] CornerTracks tracks() const;

 private:
  [[nodiscard]] GreyImage show(const Frame& frame, int margin) const;
  void changeToFlow();
  void follow(const Frame& frame);
  void match(const Frame& frame);

  int max_corners_;
  bool descriptors_;
  bool uses_flow_ = false;
  std::vector<FramePtr> frames_;
  std::vector<std::vector<Eigen::Vector2f>> places_;  // by frame, then point; NaN: not seen [px]
  GreyImage image_;            // with flow the newest, with descriptors the reference
  dsorb::Features described_;  // of the reference
  double reference_mean_ = 0;  // intensity that later images are brought to [grey levels]
  double survivor_share_ = 1;  // of the tracks in the last step
};

}  // namespace dsorb::published
