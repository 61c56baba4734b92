// SPDX-License-Identifier: BSD-3-Clause
#include "self_calibration/corner_paths.h"

#include "base/parallel.h"
#include "features/feature_tracks.h"
#include "features/grey_image.h"

#include <algorithm>
#include <cstddef>
#include <utility>

namespace dsorb::self_calibration {
namespace {

constexpr int kCorners = 500;        // followed at a time
constexpr double kFewest = 0.7;      // share of them below which new ones are found
constexpr float kMaxCorrection = 2;  // of a step by the first image of the corner [px]
constexpr std::size_t kPathsPerTask = 32;

}  // namespace

void CornerPaths::clear() {
  paths_.clear();
  mean_ = 0;
}

std::vector<Sighting> CornerPaths::add(const Frame& frame) {
  if (mean_ == 0) mean_ = meanIntensity(frame);
  const float gain = gainTowards(mean_, frame);
  std::swap(newest_, before_);
  newest_.build(frame.level(0), gain, LucasKanadeOptions());
  const std::vector<char> alive = follow(frame.timestamp() - time_);
  time_ = frame.timestamp();
  std::size_t kept = 0;
  for (std::size_t i = 0; i < paths_.size(); ++i) {
    if (alive[i] != 0) std::swap(paths_[kept++], paths_[i]);
  }
  paths_.resize(kept);
  if (static_cast<double>(kept) < kFewest * kCorners) find(frame, gain);
  std::vector<Sighting> seen;
  seen.reserve(paths_.size());
  for (const Path& path : paths_) seen.push_back({path.corner, path.place, path.velocity});
  return seen;
}

std::vector<char> CornerPaths::follow(double interval) {
  std::vector<char> alive(paths_.size());
  if (paths_.empty()) return alive;
  const cv::Size size(newest_.levels().front().width, newest_.levels().front().height);
  forEachRange(paths_.size(), kPathsPerTask, [&](std::size_t begin, std::size_t end) {
    LucasKanade step((LucasKanadeOptions()));
    for (std::size_t i = begin; i < end; ++i) {
      Path& path = paths_[i];
      Eigen::Vector2f guess = path.place;
      if (!step.follow(before_, newest_, guess) || !isUsable(guess, size, {})) continue;
      PatchPose pose{guess, path.shape};
      if (!path.patch->align(newest_.levels().front(), pose)) continue;
      const Eigen::Vector2f place = pose.place;
      if (!isUsable(place, size, {}) || (place - guess).norm() > kMaxCorrection) continue;
      path.shape = pose.shape;
      path.velocity = (place - path.place) / static_cast<float>(interval);
      path.place = place;
      alive[i] = 1;
    }
  });
  return alive;
}

/// Begins paths away from those that live.
void CornerPaths::find(const Frame& frame, float gain) {
  FeatureTrackOptions options;
  options.max_corners = kCorners;
  std::vector<Eigen::Vector2f> known;
  known.reserve(paths_.size());
  for (const Path& path : paths_) known.push_back(path.place);
  const GreyImage image = greyImage(frame.level(0), gain, kPatchReach + 1);
  const FlowLevel& finest = newest_.levels().front();
  for (const Eigen::Vector2f& place : chooseCorners(image.grey, image.valid, known, options)) {
    if (!isInside(finest, {place})) continue;
    auto patch = std::make_unique<ShapedPatch>(finest, place);
    paths_.push_back({next_++, std::move(patch), place});
  }
}

}  // namespace dsorb::self_calibration
