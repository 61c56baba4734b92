// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/semi_dense/epipolar_search.h"

#include "estimate/sampling.h"
#include "estimate/warp.h"

#include <Eigen/LU>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace dsorb::init_orb {
namespace {

constexpr double kMaxSearch = 0.25;  // longest search [image diagonals]
// Least gradient along the line [grey levels / px] and its least share of the gradient [-].
// @source docs/experiments.md, "Epipolar search"
constexpr float kMinLineGradient = 2;
constexpr float kMinGradientShare = 0.3F;
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

/// Reference patch and where its pixels lie in the target around the centre.
struct Patch {
  const EpipolarLine& line;
  std::array<float, kPatternSize> grey;
  std::array<Eigen::Vector2f, kPatternSize> offset;
  float extent = 0;  ///< largest offset along an axis [px]

  void moveBy(const Eigen::Vector2f& shift) {
    for (Eigen::Vector2f& to : offset) to += shift;
    extent += shift.lpNorm<Eigen::Infinity>();
  }
};

struct Interval {
  float begin;
  float end;
};

/// Sums over the patch at the match.
struct Match {
  float position = 0;           ///< on the line [px]
  float information = 0;        ///< sum of squared gradients along the line [grey^2/px^2]
  Eigen::Vector2f shift{0, 0};  ///< d position / d displacement of the line
};

/// Error and first derivatives of the patch by the position on the line.
struct Linearization {
  float squared_error = 0;
  float gradient = 0;
  float information = 0;
  Eigen::Vector2f cross{0, 0};  ///< sum of gradient along the line times gradient
};

struct Bounds {
  float low, high;
};

/// Shortens [begin, end] to where origin + position * direction is within the bounds. The search of
/// src/depth clips nothing: it refuses a segment that ends outside.
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

bool gradientIsUsable(const ImageSample& sample, const EpipolarLine& line) {
  const Eigen::Vector2f gradient =
      line.warp().inverse().transpose() * Eigen::Vector2f(sample.dx, sample.dy);
  const float along = std::abs(gradient.dot(line.direction()));
  return along >= kMinLineGradient && along >= kMinGradientShare * gradient.norm();
}

/// @param transfer reference to target
Patch cutPatch(const PyramidLevel& reference,
               const BrightnessTransfer& transfer,
               const Eigen::Vector2f& pixel,
               const EpipolarLine& line) {
  Patch patch{line, {}, {}};
  const int x = static_cast<int>(pixel.x());
  const int y = static_cast<int>(pixel.y());
  for (std::size_t i = 0; i < kPatternSize; ++i) {
    const float grey = reference.intensity(x + kPattern[i].x, y + kPattern[i].y);
    patch.grey[i] = static_cast<float>(transfer.gain) * grey + static_cast<float>(transfer.offset);
    patch.offset[i] = line.warp() * Eigen::Vector2f(static_cast<float>(kPattern[i].x),
                                                    static_cast<float>(kPattern[i].y));
    patch.extent = std::max(patch.extent, patch.offset[i].lpNorm<Eigen::Infinity>());
  }
  return patch;
}

Interval clippedInterval(const Patch& patch,
                         const SemiDensePoint& prior,
                         const PyramidLevel& target,
                         float max_half_length) {
  const EpipolarLine& line = patch.line;
  const float margin = patch.extent + kLineRounding;
  const float reach = kSearchSigmas * std::sqrt(prior.variance);
  const float low =
      line.positionOf(std::max(prior.inverse_depth - reach, 0.0F)).value_or(-max_half_length);
  const float high = line.positionOf(prior.inverse_depth + reach).value_or(max_half_length);
  Interval interval{std::clamp(low, -max_half_length, -kMinHalfLength),
                    std::clamp(high, kMinHalfLength, max_half_length)};
  clip(line.origin().x(),
       line.direction().x(),
       {kNearBorder + margin, static_cast<float>(target.width()) - kFarBorder - margin},
       &interval.begin,
       &interval.end);
  clip(line.origin().y(),
       line.direction().y(),
       {kNearBorder + margin, static_cast<float>(target.height()) - kFarBorder - margin},
       &interval.begin,
       &interval.end);
  return interval;
}

float cost(const PyramidLevel& target, const Patch& patch, const Eigen::Vector2f& centre) {
  float squares = 0;
  for (std::size_t i = 0; i < kPatternSize; ++i) {
    const Eigen::Vector2f at = centre + patch.offset[i];
    const float difference = interpolateIntensity(target, at.x(), at.y()) - patch.grey[i];
    squares += difference * difference;
  }
  return squares;
}

/// @return position of the best step, NaN when there is none or another is about as good
float bestStep(const PyramidLevel& target,
               const Patch& patch,
               const Interval& interval,
               float noise,
               EpipolarSearch::Scratch& costs) {
  const int steps = static_cast<int>(interval.end - interval.begin) + 1;
  costs.resize(static_cast<std::size_t>(steps));
  int best = -1;
  float best_cost = std::numeric_limits<float>::max();
  for (int i = 0; i < steps; ++i) {
    const float value = cost(target, patch, patch.line.at(interval.begin + static_cast<float>(i)));
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

Linearization linearize(const PyramidLevel& target, const Patch& patch, float position) {
  Linearization sums;
  const Eigen::Vector2f centre = patch.line.at(position);
  for (std::size_t i = 0; i < kPatternSize; ++i) {
    const Eigen::Vector2f at = centre + patch.offset[i];
    const Sample<float> sample = interpolate(target, at.x(), at.y());
    const Eigen::Vector2f gradient(sample.dx, sample.dy);
    const float difference = sample.intensity - patch.grey[i];
    const float along = gradient.dot(patch.line.direction());
    sums.squared_error += difference * difference;
    sums.gradient += along * difference;
    sums.information += along * along;
    sums.cross += along * gradient;
  }
  return sums;
}

bool refine(const PyramidLevel& target,
            const Patch& patch,
            const Interval& interval,
            Match& match) {
  const float begin = std::max(interval.begin, match.position - kMaxRefinement);
  const float end = std::min(interval.end, match.position + kMaxRefinement);
  Linearization sums = linearize(target, patch, match.position);
  for (int i = 0; i < kRefinements; ++i) {
    if (!(sums.information >= kMinLineGradient * kMinLineGradient)) {
      return false;
    }
    const float step = -sums.gradient / sums.information;
    const float position = match.position + step;
    if (!(position >= begin && position <= end)) {
      return false;
    }
    const Linearization moved = linearize(target, patch, position);
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

/// Of a match along its line [px^2]. @param found pixel of the reference and its inverse depth
float geometricVariance(const SearchFrame& frame,
                        const PinholeCamera& camera,
                        const EpipolarLine& line,
                        const SemiDensePoint& found,
                        const Match& match) {
  // A displacement d of the line moves the match by -shift . d; for one gradient direction g of
  // unit length shift = g / <g, l>. The line's error is taken to be the same in all directions as
  // it is across the line.
  const std::optional<HostedProjection> projection = projectHosted(
      camera, frame.T_cam_ref, camera.unproject(found.pixel.cast<double>()), found.inverse_depth);
  if (!projection) {
    return kNone;
  }
  const Eigen::Matrix2d position_covariance =
      projection->J_pose * frame.covariance * projection->J_pose.transpose();
  const Eigen::Vector2d normal(static_cast<double>(-line.direction().y()),
                               static_cast<double>(line.direction().x()));
  const auto sigma_squared = static_cast<float>(normal.dot(position_covariance * normal));
  return std::max(sigma_squared, kLineErrorFloor * kLineErrorFloor) * match.shift.squaredNorm();
}

constexpr float kMinZ = 0.05F;      // depth in the frame over depth in the reference
constexpr float kMinSpeed = 1e-3F;  // [px unit]: no direction can be told

}  // namespace

EpipolarSearch::EpipolarSearch(const FramePtr& reference,
                               const SearchFrame& target,
                               const PinholeCamera& camera,
                               const SemiDenseOptions& options,
                               const std::optional<RollingShutter>& reference_shutter)
    : reference_(reference->level(0)),
      target_(target.frame->level(0)),
      frame_(target),
      camera_(camera),
      options_(options),
      geometry_(camera, target.T_cam_ref),
      max_half_length_(
          static_cast<float>(0.5 * kMaxSearch * std::hypot(camera.width, camera.height))),
      reference_shutter_(reference_shutter) {}

SearchOutcome EpipolarSearch::search(const SemiDensePoint& prior, Scratch& scratch) const {
  const Eigen::Vector2f& pixel = prior.pixel;
  const Eigen::Vector2f middle =
      reference_shutter_ ? pixelInMiddle(*reference_shutter_, camera_, pixel, prior.inverse_depth)
                         : pixel;
  const std::optional<EpipolarLine> line =
      EpipolarLine::through(geometry_, middle, prior.inverse_depth);
  // The floor of the line's error limits what this frame can tell.
  if (!line || line->speed() * std::sqrt(prior.variance) < kLineErrorFloor ||
      !gradientIsUsable(reference_.at(static_cast<int>(pixel.x()), static_cast<int>(pixel.y())),
                        *line)) {
    return {};
  }
  Patch patch = cutPatch(reference_, frame_.transfer, pixel, *line);
  const Eigen::Vector2f to_row = shiftToRow(line->origin(), prior.inverse_depth);
  patch.moveBy(to_row);
  // The rows of places far outside of the image have any time, so that the shift may be infinite.
  if (!(patch.extent < static_cast<float>(target_.width()))) return {};
  const Interval interval = clippedInterval(patch, prior, target_, max_half_length_);
  if (!(interval.end - interval.begin >= 2.0F)) {
    return {};
  }
  Match match;
  const auto noise = static_cast<float>(options_.image_noise);
  match.position = bestStep(target_, patch, interval, noise, scratch);
  if (!std::isfinite(match.position) || !refine(target_, patch, interval, match)) {
    return {SearchStatus::kRejected, {}};
  }
  const EpipolarLine::Depth depth = depthOf(*line, match.position, to_row);
  const float photometric = 2.0F * noise * noise / match.information;
  const float variance =
      depth.alpha * depth.alpha *
      (geometricVariance(frame_, camera_, *line, {middle, depth.inverse_depth}, match) +
       photometric);
  if (!(depth.inverse_depth > 0) || !std::isfinite(variance) || !(variance > 0)) {
    return {SearchStatus::kRejected, {}};
  }
  return {SearchStatus::kFound, {pixel, depth.inverse_depth, variance}};
}

/// From a pixel of the target at the time of its middle row to where its own row shows it [px].
Eigen::Vector2f EpipolarSearch::shiftToRow(const Eigen::Vector2f& pixel,
                                           float inverse_depth) const {
  if (!frame_.shutter) return {0, 0};
  return pixelInRow(*frame_.shutter, camera_, pixel, inverse_depth) - pixel;
}

/// Depth of a match; the row's shift was taken at the prior's depth and is taken again at its own.
EpipolarLine::Depth EpipolarSearch::depthOf(const EpipolarLine& line,
                                            float position,
                                            const Eigen::Vector2f& shift) const {
  EpipolarLine::Depth depth = line.depthAt(position);
  if (!frame_.shutter) return depth;
  const Eigen::Vector2f again = shiftToRow(line.at(position), depth.inverse_depth);
  return line.depthAt(position + line.direction().dot(shift - again));
}

std::optional<EpipolarLine> EpipolarLine::through(const EpipolarGeometry& geometry,
                                                  const Eigen::Vector2f& pixel,
                                                  float inverse_depth) {
  EpipolarLine line;
  line.at_infinity_ = geometry.atInfinity(pixel);
  line.b_ = geometry.b;
  const Eigen::Vector3f p = line.at_infinity_ + inverse_depth * line.b_;
  if (!(p.z() > kMinZ)) {
    return std::nullopt;
  }
  const float inverse_z = 1.0F / p.z();
  line.origin_ = p.head<2>() * inverse_z;
  const Eigen::Vector2f velocity = (line.b_.head<2>() - line.origin_ * line.b_.z()) * inverse_z;
  line.speed_ = velocity.norm();
  if (!(line.speed_ > kMinSpeed)) {
    return std::nullopt;
  }
  line.direction_ = velocity / line.speed_;
  line.warp_ =
      (geometry.A.topLeftCorner<2, 2>() - line.origin_ * geometry.A.bottomLeftCorner<1, 2>()) *
      inverse_z;
  return line;
}

std::optional<float> EpipolarLine::positionOf(float inverse_depth) const {
  const Eigen::Vector3f p = at_infinity_ + inverse_depth * b_;
  if (!(p.z() > kMinZ)) {
    return std::nullopt;
  }
  return direction_.dot(p.head<2>() / p.z() - origin_);
}

EpipolarLine::Depth EpipolarLine::depthAt(float position) const {
  // at_infinity + rho b is parallel to (pixel, 1): both rows projected on the line's direction.
  const Eigen::Vector2f pixel = at(position);
  const float numerator = direction_.dot(at_infinity_.head<2>() - pixel * at_infinity_.z());
  const float denominator = direction_.dot(pixel * b_.z() - b_.head<2>());
  return {numerator / denominator,
          -(at_infinity_.z() * denominator + numerator * b_.z()) / (denominator * denominator)};
}

}  // namespace dsorb::init_orb
