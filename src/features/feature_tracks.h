// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/frame.h"
#include "dsorb/options/orb.h"

#include "features/corner_tracks.h"
#include "features/lucas_kanade.h"

#include <Eigen/Core>
#include <opencv2/core.hpp>

#include <vector>

namespace dsorb {

/// Least share of tracks that survive one step; with fewer, the scene was cut.
constexpr double kMinSurvivorShare = 0.2;
/// Share below which optical flow loses more than it keeps: the frames are far apart.
constexpr double kMinKeptShare = 0.5;

/// Corners of an image, well inside it and away from each other and from those that are there
/// already: the strongest ones of every cell, so that a textured part of the image cannot take all.
/// @source Shi and Tomasi, Good Features to Track, CVPR 1994
/// @param grey  8 bit
/// @param valid mask; empty: all of it
/// @param known places that are taken
[[nodiscard]] std::vector<Eigen::Vector2f> chooseCorners(const cv::Mat& grey,
                                                         const cv::Mat& valid,
                                                         const std::vector<Eigen::Vector2f>& known,
                                                         const FeatureTrackOptions& options);

/// Corners followed from frame to frame with Lucas-Kanade; a track must come back to where it
/// started when it is followed backwards. Only tracks that live in the newest frame are kept.
///
/// Every frame can become a reference: its corners are the tracks that live there, topped up with
/// fresh ones. So one set of tracks serves all references, each track is followed once.
/// @source Bouguet, Pyramidal Implementation of the Lucas Kanade Feature Tracker
class FeatureTracks {
 public:
  explicit FeatureTracks(const FeatureTrackOptions& options) : options_(options) {}
  FeatureTracks(const FeatureTracks&) = delete;  // the masks of copies would share memory
  FeatureTracks& operator=(const FeatureTracks&) = delete;

  /// Forgets everything and finds the corners of the first reference.
  void start(const Frame& reference);
  /// Follows all live tracks into the next frame, which has the reference's size. Runs in parallel
  /// inside the caller's arena; the result does not depend on the number of threads.
  void advance(const Frame& frame);
  /// Makes the newest frame a reference: adds corners away from the live tracks.
  void addCorners();
  /// Forgets frames, not the newest, and the tracks' positions there. A track that began in one
  /// begins in the next that is left.
  void dropFrames(int first, int count);
  void clear();

  /// Live tracks.
  [[nodiscard]] int size() const { return static_cast<int>(births_.size()); }
  /// Live tracks that were there in a frame already.
  [[nodiscard]] int sizeSince(int frame) const;
  /// Frames since the first, the first included.
  [[nodiscard]] int frames() const { return static_cast<int>(positions_.size()); }
  /// Share of the tracks that survived the last step; 1 for the first frame.
  [[nodiscard]] double survivorShare() const { return survivor_share_; }
  /// Mean intensity that later images are brought to [grey levels].
  [[nodiscard]] double referenceMean() const { return reference_mean_; }
  /// The tracks that live in every frame since a reference.
  [[nodiscard]] CornerTracks since(int reference) const;
  /// Matches between a reference and the newest frame.
  [[nodiscard]] Matches matchesFrom(int reference) const;

 private:
  void show(const Frame& frame, float gain);
  void drop(const std::vector<char>& lost);

  FeatureTrackOptions options_;
  // [frame][track], NaN before its first [px]
  std::vector<std::vector<Eigen::Vector2f>> positions_;
  std::vector<int> births_;    // first frame of each track, ascending
  cv::Mat valid_;              // mask of the newest image; empty: all of it
  FlowPyramid pyramid_;        // of the newest image
  FlowPyramid other_pyramid_;  // memory for the next one
  double survivor_share_ = 1;
  double reference_mean_ = 0;  // intensity that later images are brought to [grey levels]
};

}  // namespace dsorb
