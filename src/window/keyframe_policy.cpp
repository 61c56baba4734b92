// SPDX-License-Identifier: BSD-3-Clause
#include "window/keyframe_policy.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>

namespace dsorb::window {
namespace {

// When a keyframe is added and which one leaves, as published with DSO.
constexpr double kTranslationWeight = 44.8;  // of the flow by translation over width + height;
                                             // 0.04 * 1120
constexpr double kFlowWeight = 22.4;         // of the whole flow over width + height; 0.02 * 1120
constexpr double kBrightnessWeight = 2;      // of the absolute log gain
constexpr double kMinAliveShare = 0.05;      // a keyframe with fewer of its points left leaves
constexpr double kMaxLogGain = 0.7;          // to the newest keyframe; more leaves
constexpr double kDistanceOffset = 1e-5;     // relative to the window's extent; keeps scores finite

double extent(const std::vector<KeyframeSummary>& keyframes) {
  double largest = 0;
  for (const KeyframeSummary& keyframe : keyframes) {
    largest = std::max(largest, (keyframe.center - keyframes.back().center).norm());
  }
  return largest > 0 ? largest : 1.0;
}

/// Large for a keyframe far from the newest and close to the others: it leaves first.
double distanceScore(const std::vector<KeyframeSummary>& keyframes, std::size_t i, double offset) {
  double sum = 0;
  for (std::size_t j = 0; j < keyframes.size(); ++j) {
    if (j == i) continue;
    sum += 1.0 / ((keyframes[i].center - keyframes[j].center).norm() + offset);
  }
  return std::sqrt((keyframes[i].center - keyframes.back().center).norm()) * sum;
}

/// The keyframe, neither the first nor the newest nor already leaving, with the highest score;
/// equal scores (a camera that stands) take the oldest.
std::optional<std::size_t> worstPlaced(const std::vector<KeyframeSummary>& keyframes,
                                       const std::vector<bool>& leaving) {
  const double offset = kDistanceOffset * extent(keyframes);
  std::optional<std::size_t> worst;
  double worst_score = 0;
  for (std::size_t i = 0; i + 1 < keyframes.size(); ++i) {
    if (leaving[i] || keyframes[i].is_first) continue;
    const double score = distanceScore(keyframes, i, offset);
    if (worst && !(score > worst_score)) continue;
    worst = i;
    worst_score = score;
  }
  return worst;
}

}  // namespace

bool needsKeyframe(const KeyframeCues& cues, const WindowOptions& options) {
  const double flow = (kTranslationWeight * std::sqrt(cues.translation_flow) +
                       kFlowWeight * std::sqrt(cues.full_flow)) /
                      cues.width_plus_height;
  const double brightness = kBrightnessWeight * std::abs(cues.log_gain);
  return options.keyframe_frequency * (flow + brightness) > 1;
}

std::vector<bool> chooseLeaving(const std::vector<KeyframeSummary>& keyframes,
                                const WindowOptions& options) {
  std::vector<bool> leaving(keyframes.size(), false);
  auto staying = static_cast<int>(keyframes.size());
  for (std::size_t i = 0; i < keyframes.size(); ++i) {
    const KeyframeSummary& keyframe = keyframes[i];
    const bool empty = keyframe.alive < kMinAliveShare * (keyframe.alive + keyframe.gone);
    const bool other_brightness = std::abs(keyframe.log_gain) > kMaxLogGain;
    if ((empty || other_brightness) && staying > options.min_keyframes) {
      leaving[i] = true;
      --staying;
    }
  }
  if (staying >= options.max_keyframes) {
    const std::optional<std::size_t> worst = worstPlaced(keyframes, leaving);
    if (worst) leaving[*worst] = true;
  }
  return leaving;
}

void flagLeaving(Window& window, const WindowOptions& options) {
  if (window.keyframes.empty()) return;
  const Keyframe& newest = window.keyframes.back();
  std::vector<KeyframeSummary> summaries;
  for (const Keyframe& keyframe : window.keyframes) {
    const BrightnessTransfer transfer = brightnessTransfer(
        newest.affine(), newest.frame->exposure(), keyframe.affine(), keyframe.frame->exposure());
    summaries.push_back({keyframe.id.value == 0,
                         static_cast<int>(keyframe.points.size() + keyframe.candidates.size()),
                         static_cast<int>(keyframe.marginalized.size()) + keyframe.discarded,
                         std::log(transfer.gain),
                         keyframe.T_cam_world().inverse().translation()});
  }
  const std::vector<bool> leaving = chooseLeaving(summaries, options);
  for (std::size_t i = 0; i < leaving.size(); ++i) window.keyframes[i].leaves = leaving[i];
}

}  // namespace dsorb::window
