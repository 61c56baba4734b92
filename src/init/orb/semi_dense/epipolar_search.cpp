// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/semi_dense/epipolar_search.h"

#include "estimate/sampling.h"
#include "estimate/warp.h"

#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <limits>

namespace dsorb::init_orb {
namespace {

constexpr double kMaxSearch = 0.25;        // longest search [image diagonals]
constexpr float kMinGradientShare = 0.3F;  // least |gradient along the line| / |gradient| [-]
constexpr float kMaxResidual = 16;        // largest rms of a matched patch [grey levels]; LSD: 1300
                                          // over 5 samples
constexpr float kSecondBestRatio = 1.5F;  // least ratio of the second-best minimum to the best [-]
constexpr float kLineErrorFloor = 0.2F;   // least error of the epipolar line [px]
constexpr float kMinHalfLength = 1.5F;    // a minimum needs neighbours on both sides [px]
constexpr int kRefinements = 5;           // Gauss-Newton steps along the line
constexpr float kMaxRefinement = 1.5F;    // farther from the best step is another minimum [px]
constexpr float kConverged = 0.01F;       // [px]
constexpr int kNeighbourhood = 2;         // steps around the best that belong to its minimum
constexpr float kNone = std::numeric_limits<float>::quiet_NaN();

struct Bounds {
  float low, high;
};

/// Shortens [begin, end] to where origin + position * direction is within the bounds.
void clip(float origin, float direction, const Bounds& bounds, float* begin, float* end) {
  if (std::abs(direction) < 1e-6F) {
    if (!(origin >= bounds.low && origin <= bounds.high)) {
      *end = *begin - 1;
    }
    return;
  }
  const float a = (bounds.low - origin) / direction;
  const float b = (bounds.high - origin) / direction;
  *begin = std::max(*begin, std::min(a, b));
  *end = std::min(*end, std::max(a, b));
}

}  // namespace

EpipolarSearch::EpipolarSearch(const FramePtr& reference,
                               const SearchFrame& target,
                               const PinholeCamera& camera,
                               const SemiDenseOptions& options)
    : reference_(reference->level(0)),
      target_(target.frame->level(0)),
      frame_(target),
      camera_(camera),
      options_(options),
      geometry_(camera, target.T_cam_ref),
      max_half_length_(
          static_cast<float>(0.5 * kMaxSearch * std::hypot(camera.width, camera.height))) {}

SearchOutcome EpipolarSearch::search(const SemiDensePoint& prior, Scratch& scratch) const {
  const Eigen::Vector2f& pixel = prior.pixel;
  const std::optional<EpipolarLine> line =
      EpipolarLine::through(geometry_, pixel, prior.inverse_depth);
  // The floor of the line's error limits what this frame can tell.
  if (!line || line->speed() * std::sqrt(prior.variance) < kLineErrorFloor ||
      !gradientIsUsable(pixel, *line)) {
    return {};
  }
  const Patch patch = cutPatch(pixel, *line);
  const Interval interval = clippedInterval(*line, prior, patch.extent);
  if (!(interval.end - interval.begin >= 2.0F)) {
    return {};
  }
  Match match;
  match.position = bestStep(patch, *line, interval, scratch);
  if (!std::isfinite(match.position) || !refine(patch, *line, interval, match)) {
    return {SearchStatus::kRejected, {}};
  }
  const EpipolarLine::Depth depth = line->depthAt(match.position);
  const auto noise = static_cast<float>(frame_.image_noise);
  const float photometric = 2.0F * noise * noise / match.information;
  const float variance =
      depth.alpha * depth.alpha *
      (geometricVariance(pixel, *line, match, depth.inverse_depth) + photometric);
  if (!(depth.inverse_depth > 0) || !std::isfinite(variance) || !(variance > 0)) {
    return {SearchStatus::kRejected, {}};
  }
  return {SearchStatus::kFound, {pixel, depth.inverse_depth, variance}};
}

bool EpipolarSearch::gradientIsUsable(const Eigen::Vector2f& pixel,
                                      const EpipolarLine& line) const {
  const ImageSample& sample =
      reference_.at(static_cast<int>(pixel.x()), static_cast<int>(pixel.y()));
  const Eigen::Vector2f gradient =
      line.warp().inverse().transpose() * Eigen::Vector2f(sample.dx, sample.dy);
  const float along = std::abs(gradient.dot(line.direction()));
  return along >= options_.min_line_gradient && along >= kMinGradientShare * gradient.norm();
}

EpipolarSearch::Patch EpipolarSearch::cutPatch(const Eigen::Vector2f& pixel,
                                               const EpipolarLine& line) const {
  Patch patch;
  const int x = static_cast<int>(pixel.x());
  const int y = static_cast<int>(pixel.y());
  for (std::size_t i = 0; i < kPatternSize; ++i) {
    const float grey = reference_.at(x + kPattern[i].x, y + kPattern[i].y).intensity;
    patch.grey[i] = static_cast<float>(frame_.transfer.gain) * grey +
                    static_cast<float>(frame_.transfer.offset);
    patch.offset[i] = line.warp() * Eigen::Vector2f(static_cast<float>(kPattern[i].x),
                                                    static_cast<float>(kPattern[i].y));
    patch.extent = std::max(patch.extent, patch.offset[i].lpNorm<Eigen::Infinity>());
  }
  return patch;
}

EpipolarSearch::Interval EpipolarSearch::clippedInterval(const EpipolarLine& line,
                                                         const SemiDensePoint& prior,
                                                         float margin) const {
  const float reach = kSearchSigmas * std::sqrt(prior.variance);
  const float low =
      line.positionOf(std::max(prior.inverse_depth - reach, 0.0F)).value_or(-max_half_length_);
  const float high = line.positionOf(prior.inverse_depth + reach).value_or(max_half_length_);
  Interval interval{std::clamp(low, -max_half_length_, -kMinHalfLength),
                    std::clamp(high, kMinHalfLength, max_half_length_)};
  clip(line.origin().x(),
       line.direction().x(),
       {kNearBorder + margin, static_cast<float>(target_.width()) - kFarBorder - margin},
       &interval.begin,
       &interval.end);
  clip(line.origin().y(),
       line.direction().y(),
       {kNearBorder + margin, static_cast<float>(target_.height()) - kFarBorder - margin},
       &interval.begin,
       &interval.end);
  return interval;
}

float EpipolarSearch::cost(const Patch& patch, const Eigen::Vector2f& centre) const {
  float squares = 0;
  for (std::size_t i = 0; i < kPatternSize; ++i) {
    const Eigen::Vector2f at = centre + patch.offset[i];
    const float difference = interpolateIntensity(target_, at.x(), at.y()) - patch.grey[i];
    squares += difference * difference;
  }
  return squares;
}

float EpipolarSearch::bestStep(const Patch& patch,
                               const EpipolarLine& line,
                               const Interval& interval,
                               Scratch& costs) const {
  const int steps = static_cast<int>(interval.end - interval.begin) + 1;
  costs.resize(static_cast<std::size_t>(steps));
  int best = -1;
  float best_cost = std::numeric_limits<float>::max();
  for (int i = 0; i < steps; ++i) {
    const float value = cost(patch, line.at(interval.begin + static_cast<float>(i)));
    costs[static_cast<std::size_t>(i)] = value;
    if (value < best_cost) {  // never true for an invalid pixel's NaN
      best_cost = value;
      best = i;
    }
  }
  if (best < 0) {
    return kNone;
  }
  const auto at = [&](int i) {
    return i >= 0 && i < steps ? costs[static_cast<std::size_t>(i)]
                               : std::numeric_limits<float>::max();
  };
  // Differences below the noise tell nothing.
  const auto noise = static_cast<float>(frame_.image_noise);
  const float limit =
      kSecondBestRatio * std::max(best_cost, static_cast<float>(kPatternSize) * noise * noise);
  for (int i = 0; i < steps; ++i) {
    const bool other = std::abs(i - best) > kNeighbourhood;
    if (other && at(i) < limit && at(i) <= at(i - 1) && at(i) <= at(i + 1)) {
      return kNone;
    }
  }
  return interval.begin + static_cast<float>(best);
}

EpipolarSearch::Linearization EpipolarSearch::linearize(const Patch& patch,
                                                        const EpipolarLine& line,
                                                        float position) const {
  Linearization sums;
  const Eigen::Vector2f centre = line.at(position);
  for (std::size_t i = 0; i < kPatternSize; ++i) {
    const Eigen::Vector2f at = centre + patch.offset[i];
    const Sample<float> sample = interpolate(target_, at.x(), at.y());
    const Eigen::Vector2f gradient(sample.dx, sample.dy);
    const float difference = sample.intensity - patch.grey[i];
    const float along = gradient.dot(line.direction());
    sums.squared_error += difference * difference;
    sums.gradient += along * difference;
    sums.information += along * along;
    sums.cross += along * gradient;
  }
  return sums;
}

bool EpipolarSearch::refine(const Patch& patch,
                            const EpipolarLine& line,
                            const Interval& interval,
                            Match& match) const {
  const float begin = std::max(interval.begin, match.position - kMaxRefinement);
  const float end = std::min(interval.end, match.position + kMaxRefinement);
  Linearization sums = linearize(patch, line, match.position);
  const auto min_gradient = static_cast<float>(options_.min_line_gradient);
  for (int i = 0; i < kRefinements; ++i) {
    if (!(sums.information >= min_gradient * min_gradient)) {
      return false;
    }
    const float step = -sums.gradient / sums.information;
    const float position = match.position + step;
    if (!(position >= begin && position <= end)) {
      return false;
    }
    const Linearization moved = linearize(patch, line, position);
    if (!(moved.squared_error <= sums.squared_error)) {
      break;
    }
    match.position = position;
    sums = moved;
    if (std::abs(step) < kConverged) {
      break;
    }
  }
  match.information = sums.information;
  match.shift = sums.cross / sums.information;
  return sums.squared_error <= static_cast<float>(kPatternSize) * kMaxResidual * kMaxResidual;
}

float EpipolarSearch::geometricVariance(const Eigen::Vector2f& pixel,
                                        const EpipolarLine& line,
                                        const Match& match,
                                        float inverse_depth) const {
  // A displacement d of the line moves the match by -shift . d; for one gradient direction g of
  // unit length shift = g / <g, l>. The line's error is taken to be the same in all directions as
  // it is across the line.
  const std::optional<HostedProjection> projection = projectHosted(
      camera_, frame_.T_cam_ref, camera_.unproject(pixel.cast<double>()), inverse_depth);
  if (!projection) {
    return kNone;
  }
  const Eigen::Matrix2d position_covariance =
      projection->J_pose * frame_.covariance * projection->J_pose.transpose();
  const Eigen::Vector2d normal(static_cast<double>(-line.direction().y()),
                               static_cast<double>(line.direction().x()));
  const auto sigma_squared = static_cast<float>(normal.dot(position_covariance * normal));
  return std::max(sigma_squared, kLineErrorFloor * kLineErrorFloor) * match.shift.squaredNorm();
}

}  // namespace dsorb::init_orb
