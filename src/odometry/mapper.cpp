// SPDX-License-Identifier: BSD-3-Clause
#include "odometry/mapper.h"

#include "odometry/seed_window.h"
#include "window/handover.h"
#include "window/keyframe_policy.h"
#include "window/marginalization.h"

#include <utility>

namespace dsorb::odometry {
namespace {

constexpr std::size_t kCandidatesPerTask = 64;
constexpr std::size_t kChunksPerTask = 2;  // of 128 points each, in the adjustment
constexpr std::size_t kPatternCenter = 4;  // index into kPattern

PixelSelectorOptions selectorOptions(const OdometryOptions& options) {
  PixelSelectorOptions selector;
  selector.seed = options.initializer.seed;
  return selector;
}

}  // namespace

Mapper::Mapper(const PinholeCamera& camera, const OdometryOptions& options)
    : camera_(camera),
      options_(options),
      selector_(camera.width, camera.height, selectorOptions(options)),
      optimizer_(options.window, kChunksPerTask) {}

MappingReport Mapper::seed(const InitializationResult& result) {
  selector_ = PixelSelector(camera_.width, camera_.height, selectorOptions(options_));
  window_ = seedWindow(result, camera_, options_, selector_, kCandidatesPerTask);
  return adjust();
}

void Mapper::refine(const window::TrackedFrame& tracked) {
  window::refineCandidates(*window_, tracked, options_.depth.epipolar, kCandidatesPerTask);
}

MappingReport Mapper::addKeyframe(const window::TrackedFrame& tracked) {
  window::flagLeaving(*window_, options_.window);
  window::addKeyframe(
      *window_, tracked.frame, tracked.T_cam_world, tracked.affine, options_.window);
  window::activateCandidates(*window_, options_.window, options_.depth, kCandidatesPerTask);
  return adjust();
}

MappingReport Mapper::adjust() {
  MappingReport report;
  report.keyframes_so_far = window_->next_keyframe;
  report.adjustment = optimizer_.optimize(*window_);
  if (!report.adjustment.finite) return report;
  report.reference = window::depthSamples(*window_, options_.window);
  window::retirePoints(*window_, options_.window);
  selectCandidates(window_->keyframes.back(), selector_, options_.depth.candidates_per_keyframe);
  report.retired = window::marginalizeFlagged(*window_, options_.window);
  return report;
}

std::vector<window::Keyframe> Mapper::clear() {
  if (!window_) return {};
  std::vector<window::Keyframe> keyframes = std::move(window_->keyframes);
  window_.reset();
  return keyframes;
}

KeyframeSnapshot snapshot(const window::Keyframe& keyframe,
                          const PinholeCamera& camera,
                          int segment,
                          double noise) {
  KeyframeSnapshot shot{keyframe.frame->id(),
                        keyframe.frame->timestamp(),
                        segment,
                        keyframe.T_cam_world().inverse(),
                        keyframe.affine(),
                        camera,
                        {}};
  shot.points.reserve(keyframe.points.size() + keyframe.marginalized.size());
  const auto variance = static_cast<float>(noise * noise);
  for (const window::RetiredPoint& point : keyframe.marginalized) {
    shot.points.push_back(
        {point.pixel, point.inverse_depth, variance / point.information, point.intensity});
  }
  for (const window::WindowPoint& point : keyframe.points) {
    if (!(point.information > 0) || !(point.inverse_depth > 0)) continue;
    shot.points.push_back({point.pixel,
                           point.inverse_depth,
                           variance / point.information,
                           point.patch.intensity[kPatternCenter]});
  }
  return shot;
}

}  // namespace dsorb::odometry
