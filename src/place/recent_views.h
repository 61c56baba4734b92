// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/odometry/observer.h"
#include "dsorb/odometry/odometry.h"

#include "features/feature_matches.h"
#include "features/grey_image.h"
#include "place/recognition.h"

#include <cstddef>
#include <deque>
#include <map>
#include <optional>
#include <vector>

namespace dsorb::place {

/// A keyframe with its image at half the size.
struct RecentView {
  FrameId id;
  std::optional<KeyframeSnapshot> keyframe;  ///< as told last
  GreyImage image;
  Features features;
  bool is_described = false;  ///< whether these are the image's
};

/// What is remembered of a frame; nothing where its pyramid has one level only.
[[nodiscard]] std::optional<RecentView> viewOf(FrameId id, const Frame& frame);

/// Sixteen keyframes as SIFT sees them, for a frame that shows their place from another side.
/// Nothing is described before it is asked for, and four of them for one frame at most.
class RecentViews {
 public:
  static constexpr std::size_t kViews = 16;

  /// Remembers a keyframe, in place of the oldest where all are there.
  void add(const RecentView& view);
  /// What is told of a keyframe, the newest counts.
  void tell(const KeyframeSnapshot& keyframe);

  /// Where a frame was taken: the pose that most of the corners agree with, which it has in common
  /// with any of the keyframes. Some frames after the newest keyframe it is not looked for any
  /// more, unless the one before was found; frames that show hardly anything do not count. Runs in
  /// parallel inside the caller's arena.
  /// @param camera of the frame
  [[nodiscard]] std::optional<RecognizedPlace> find(const Frame& frame,
                                                    const PinholeCamera& camera);
  /// Links of every second view of another segment to these. Runs in parallel inside the caller's
  /// arena.
  /// @param positions of keyframes in the store
  [[nodiscard]] std::vector<Link> linksTo(RecentViews& others,
                                          const std::map<FrameId, std::size_t>& positions);

  /// Segment of the newest view that was told.
  [[nodiscard]] std::optional<int> segment() const;
  [[nodiscard]] std::size_t size() const { return views_.size(); }

 private:
  std::deque<RecentView> views_;  // the newest last
  int asked_ = 0;                 // without an answer, since the newest keyframe
};

/// Gives a place the depth of a corner, and of the pixels beside it: trackers see other corners.
void addDepth(const Eigen::Vector2f& pixel, double depth, double sigma, RecognizedPlace& place);

}  // namespace dsorb::place
