// SPDX-License-Identifier: BSD-3-Clause
#include "track/grey_comparison.h"

#include "estimate/sampling.h"
#include "estimate/warp.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

namespace dsorb::track {
namespace {

constexpr std::size_t kPoints = 600;    // looked at
constexpr std::size_t kMinPoints = 20;  // that are not clipped
constexpr double kTail = 0.05;          // of the points at either end, left out
constexpr double kMinContrast = 5;      // standard deviation in the reference [grey levels]

// An image is clipped at its largest or smallest grey level if many points have it.
constexpr double kManyPoints = 0.02;  // of all
constexpr float kSameGrey = 2;        // so near to the extreme counts as it [grey levels]
/// Share of the range of grey levels in which, near the extreme, edges are partly clipped.
constexpr float kClippedMargin = 0.15F;

/// Grey levels between which an image is not clipped.
struct GreyRange {
  float darkest = -std::numeric_limits<float>::infinity();
  float brightest = std::numeric_limits<float>::infinity();

  [[nodiscard]] bool contains(float grey) const { return grey > darkest && grey < brightest; }
};

GreyRange unclippedRange(const std::vector<float>& sorted) {
  GreyRange range;
  const auto many = static_cast<std::size_t>(kManyPoints * static_cast<double>(sorted.size()));
  const float lowest = sorted.front();
  const float highest = sorted.back();
  const float margin = kClippedMargin * (highest - lowest);
  if (sorted[many] <= lowest + kSameGrey) range.darkest = lowest + margin;
  if (sorted[sorted.size() - 1 - many] >= highest - kSameGrey) range.brightest = highest - margin;
  return range;
}

/// The ranks that count.
std::pair<std::size_t, std::size_t> withoutTails(std::size_t count) {
  const auto tail = static_cast<std::size_t>(kTail * static_cast<double>(count));
  return {tail, count - tail};
}

}  // namespace

GreyComparison::GreyComparison(const TrackingReference& reference,
                               const Frame& frame,
                               const SE3& T_cur_ref) {
  const ReferencePoints& points = reference.at(0);
  const PyramidLevel& level = frame.level(0);
  const auto warp = makeWarp<float>(reference.camera, T_cur_ref);
  const std::size_t stride = std::max<std::size_t>(points.size() / kPoints, 1);
  for (std::size_t i = 0; i < points.size(); i += stride) {
    WarpedPoint<float> p;
    warpPoint(warp, points.ray_x[i], points.ray_y[i], points.inverse_depth[i], p);
    if (!p.front || !canSample(level, p.x, p.y)) continue;
    const float intensity = interpolateIntensity(level, p.x, p.y);
    if (!std::isfinite(intensity)) continue;
    reference_.push_back(points.intensity[i]);
    frame_.push_back(intensity);
  }
  std::sort(reference_.begin(), reference_.end());
  std::sort(frame_.begin(), frame_.end());
  if (!frame_.empty() && std::isfinite(unclippedRange(frame_).brightest)) ceiling_ = frame_.back();
}

std::optional<BrightnessTransfer> GreyComparison::transfer() const {
  if (frame_.size() < kMinPoints) return std::nullopt;
  const GreyRange reference_range = unclippedRange(reference_);
  const GreyRange frame_range = unclippedRange(frame_);
  const auto [begin, end] = withoutTails(frame_.size());
  double n = 0;
  double x = 0;
  double y = 0;
  double xx = 0;
  double xy = 0;
  for (std::size_t i = begin; i < end; ++i) {
    if (!reference_range.contains(reference_[i]) || !frame_range.contains(frame_[i])) continue;
    const auto from = static_cast<double>(reference_[i]);
    const auto to = static_cast<double>(frame_[i]);
    n += 1;
    x += from;
    y += to;
    xx += from * from;
    xy += from * to;
  }
  if (n < static_cast<double>(kMinPoints)) return std::nullopt;
  const double variance = xx / n - x / n * (x / n);
  if (!(variance > kMinContrast * kMinContrast)) return std::nullopt;
  const double gain = (xy / n - x / n * (y / n)) / variance;
  if (!(gain > 0)) return std::nullopt;
  return BrightnessTransfer{gain, (y - gain * x) / n};
}

double GreyComparison::misfit(const BrightnessTransfer& transfer) const {
  const auto [begin, end] = withoutTails(frame_.size());
  const auto n = static_cast<double>(end - begin);
  double errors = 0;
  double sum = 0;
  double squares = 0;
  for (std::size_t i = begin; i < end; ++i) {
    const auto grey = static_cast<double>(frame_[i]);
    const double predicted = transfer.gain * static_cast<double>(reference_[i]) + transfer.offset;
    const double error = grey - std::min(predicted, static_cast<double>(ceiling_));
    errors += error * error;
    sum += grey;
    squares += grey * grey;
  }
  const double variance = squares / n - sum / n * (sum / n);
  return variance > 0 ? std::sqrt(errors / n / variance) : std::numeric_limits<double>::infinity();
}

}  // namespace dsorb::track
