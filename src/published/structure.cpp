// SPDX-License-Identifier: BSD-3-Clause
#include "published/structure.h"

#include "base/parallel.h"
#include "base/random.h"
#include "estimate/epipolar_geometry.h"
#include "estimate/warp.h"
#include "image/cell_grid.h"
#include "image/image_scale.h"
#include "image/photometric.h"
#include "image/pixel_selector.h"
#include "published/bundle_adjustment.h"

#include <Eigen/LU>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

namespace dsorb::published {
namespace {

// Candidates and their priors.
constexpr int kPatchSide = 6;              // one candidate in a square of this side [px]
constexpr std::size_t kCandidates = 3000;  // that are searched at most
constexpr double kRadius = 60;  // corners farther away do not count, at a diagonal of 800 px [px]
constexpr float kCellSize = 0.5F;          // of the radius
constexpr std::size_t kNeighbours = 5;     // nearest corners a prior is made of
constexpr std::size_t kMinNeighbours = 3;  // for a spread that means something
constexpr float kWiden = 2;                // of the range of all corners
constexpr float kMinPriorSigma = 0.1F;     // of a prior, relative to its inverse depth [-]
constexpr float kGate = 3;                 // of an observation [combined sigma]
constexpr int kMaxVotes = 3;               // so many remove a pixel

// Search.
constexpr float kSearchSigmas = 2;         // half length of the searched interval [sigma]
constexpr float kImageNoise = 6.3246F;     // sigma_i: sigma_i^2 = 4 * 10, eq. (7) [grey levels]
constexpr double kMaxSearch = 0.25;        // longest search [image diagonals]
constexpr float kMinHalfLength = 1.5F;     // a minimum needs neighbours on both sides [px]
constexpr float kMinLineGradient = 2;      // least gradient along the line [grey levels / px]
constexpr float kMinGradientShare = 0.3F;  // least share of the gradient that runs along the line
constexpr float kMaxResidual = 16;         // largest rms of a matched patch [grey levels]
constexpr float kSecondBestRatio = 1.5F;   // least ratio of the second-best minimum to the best [-]
constexpr int kNeighbourhood = 2;          // steps around the best that belong to its minimum
constexpr int kRefinements = 5;            // Gauss-Newton steps along the line
constexpr float kMaxShift = 1.5F;          // farther from the best step is another minimum [px]
constexpr float kSettled = 0.01F;          // [px]
constexpr float kLineErrorFloor = 0.2F;    // least sigma_l [px]
constexpr float kMinZ = 0.05F;             // depth in the frame over depth in the reference
constexpr float kMinSpeed = 1e-3F;         // [px unit]: no direction can be told

/// Grows the patches until few enough candidates are left; candidates that are still too many are
/// removed at random.
std::vector<SelectedPixel> selectCandidates(const Frame& reference, std::uint64_t seed) {
  RegionThresholds thresholds;
  thresholds.compute(reference);
  std::vector<SelectedPixel> selected = selectPatchMaxima(reference, thresholds, kPatchSide);
  // The count is about proportional to 1 / side^2.
  const double ratio = static_cast<double>(selected.size()) / static_cast<double>(kCandidates);
  const auto better_side = static_cast<int>(kPatchSide * std::sqrt(ratio));
  if (better_side > kPatchSide) selected = selectPatchMaxima(reference, thresholds, better_side);
  Random random(seed);
  for (; selected.size() > kCandidates; selected.pop_back()) {
    std::swap(selected[random.below(static_cast<std::uint32_t>(selected.size()))], selected.back());
  }
  return selected;
}

/// Inverse depth as a Gaussian.
struct DepthEstimate {
  float inverse_depth = 0;  // [1/unit]
  float variance = 0;       // [1/unit^2]
};

/// Guesses the inverse depth of any pixel of the reference from the corners around it: their mean
/// weighted by 1 / distance, with their spread and their own variances. With fewer than 3 corners
/// close by it is a Gaussian whose searched interval is the range of all corners, widened by a
/// factor 2 at both ends.
class CornerPrior {
 public:
  CornerPrior(const Map& map, const PinholeCamera& camera)
      : radius_(static_cast<float>(kRadius * imageScale(camera.width, camera.height))),
        corners_(map.points.begin(), map.points.begin() + static_cast<std::ptrdiff_t>(map.corners)),
        grid_(pixelsOf(corners_), CellGrid(camera.width, camera.height, kCellSize * radius_)) {
    const auto [low, high] = std::minmax_element(
        corners_.begin(), corners_.end(), [](const MapPoint& a, const MapPoint& b) {
          return a.inverse_depth < b.inverse_depth;
        });
    const float least = static_cast<float>(low->inverse_depth) / kWiden;
    const float greatest = static_cast<float>(high->inverse_depth) * kWiden;
    const float sigma = 0.5F * (greatest - least) / kSearchSigmas;
    wide_ = {0.5F * (least + greatest), sigma * sigma};
  }

  [[nodiscard]] DepthEstimate at(const Eigen::Vector2f& pixel) const {
    const auto neighbours = grid_.nearest<kNeighbours>(pixel, radius_);
    if (neighbours.count < kMinNeighbours) return wide_;
    const auto weightedMean = [&](const auto& value) {
      float sum = 0;
      float mean = 0;
      for (const auto& [squared_distance, corner] : neighbours) {
        const float weight = 1.0F / (1.0F + std::sqrt(squared_distance));
        sum += weight;
        mean += weight * value(corners_[corner]);
      }
      return mean / sum;
    };
    const float mean = weightedMean(
        [](const MapPoint& corner) { return static_cast<float>(corner.inverse_depth); });
    const float variance = weightedMean([mean](const MapPoint& corner) {
      const float difference = static_cast<float>(corner.inverse_depth) - mean;
      return difference * difference + static_cast<float>(corner.variance);
    });
    return {mean, std::max(variance, std::pow(kMinPriorSigma * mean, 2.0F))};
  }

 private:
  static std::vector<Eigen::Vector2f> pixelsOf(const std::vector<MapPoint>& corners) {
    std::vector<Eigen::Vector2f> pixels;
    for (const MapPoint& corner : corners) pixels.push_back(corner.pixel);
    return pixels;
  }

  float radius_;  // within which corners count [px]
  std::vector<MapPoint> corners_;
  PointGrid grid_;
  DepthEstimate wide_;  // where there are none
};

/// Inverse depth of one pixel, updated from frame to frame by the product of prior and observation;
/// one farther than kGate from the estimate counts as a vote against the pixel.
/// @source [Gladkova], section 3.3; Engel, Sturm, Cremers, ICCV 2013, section 2.3
struct FusedDepth {
  DepthEstimate current;
  int searches = 0;
  int observations = 0;
  int votes = 0;

  void add(const DepthEstimate& observed) {
    const float difference = observed.inverse_depth - current.inverse_depth;
    const float sum = current.variance + observed.variance;
    if (difference * difference > kGate * kGate * sum) {
      ++votes;
      return;
    }
    current = {
        (current.variance * observed.inverse_depth + observed.variance * current.inverse_depth) /
            sum,
        current.variance * observed.variance / sum};
    ++observations;
  }
};

/// Epipolar line of one reference pixel. Positions along it are pixels from `origin`, growing with
/// the inverse depth.
struct EpipolarLine {
  Eigen::Vector3f at_infinity;  // A (x, y, 1)
  Eigen::Vector3f b;
  Eigen::Vector2f origin;
  Eigen::Vector2f direction;  // of length 1
  Eigen::Matrix2f warp;  // d pixel / d reference pixel at a constant inverse depth, at `origin`
  float speed = 0;       // d position / d inverse depth at `origin` [px unit]

  /// @param inverse_depth where `origin` and the warp are taken [1/unit]
  /// @return nullopt behind the camera or where the line has no direction (at the epipole)
  static std::optional<EpipolarLine> through(const EpipolarGeometry& geometry,
                                             const Eigen::Vector2f& pixel,
                                             float inverse_depth) {
    EpipolarLine line;
    line.at_infinity = geometry.atInfinity(pixel);
    line.b = geometry.b;
    const Eigen::Vector3f p = line.at_infinity + inverse_depth * line.b;
    if (!(p.z() > kMinZ)) return std::nullopt;
    const float inverse_z = 1.0F / p.z();
    line.origin = p.head<2>() * inverse_z;
    const Eigen::Vector2f velocity = (line.b.head<2>() - line.origin * line.b.z()) * inverse_z;
    line.speed = velocity.norm();
    if (!(line.speed > kMinSpeed)) return std::nullopt;
    line.direction = velocity / line.speed;
    line.warp =
        (geometry.A.topLeftCorner<2, 2>() - line.origin * geometry.A.bottomLeftCorner<1, 2>()) *
        inverse_z;
    return line;
  }

  [[nodiscard]] Eigen::Vector2f at(float position) const { return origin + position * direction; }
  /// Position of an inverse depth [px]; nullopt behind the camera.
  [[nodiscard]] std::optional<float> positionOf(float inverse_depth) const {
    const Eigen::Vector3f p = at_infinity + inverse_depth * b;
    if (!(p.z() > kMinZ)) return std::nullopt;
    return direction.dot(p.head<2>() / p.z() - origin);
  }
  /// Inverse depth at a position [1/unit] and its derivative there, alpha of eq. (9).
  [[nodiscard]] std::pair<float, float> depthAt(float position) const {
    // at_infinity + rho b is parallel to (pixel, 1): both rows projected on the line's direction.
    const Eigen::Vector2f pixel = at(position);
    const float numerator = direction.dot(at_infinity.head<2>() - pixel * at_infinity.z());
    const float denominator = direction.dot(pixel * b.z() - b.head<2>());
    return {numerator / denominator,
            -(at_infinity.z() * denominator + numerator * b.z()) / (denominator * denominator)};
  }
};

/// Reference patch and where its pixels lie in the target around the centre.
struct Patch {
  EpipolarLine line;
  std::array<float, kPatternSize> grey;
  std::array<Eigen::Vector2f, kPatternSize> offset;
  float extent = 0;  ///< largest offset along an axis [px]
};

struct Interval {
  float begin;
  float end;
};

/// Sums over the patch at a position on the line.
struct Match {
  float position = 0;           ///< [px]
  float squared_error = 0;      ///< [grey^2]
  float gradient = 0;           ///< half its derivative
  float information = 0;        ///< sum of squared gradients along the line [grey^2/px^2]
  Eigen::Vector2f cross{0, 0};  ///< sum of gradient along the line times gradient
};

/// Shortens an interval to where origin + position * direction keeps within the image.
void clip(float origin, float direction, float extent, int size, Interval& interval) {
  const float low = kNearBorder + (extent + kLineRounding);
  const float high = static_cast<float>(size) - kFarBorder - (extent + kLineRounding);
  if (std::abs(direction) < 1e-6F) {
    if (!(origin >= low && origin <= high)) interval.end = interval.begin - 1;
    return;
  }
  const float a = (low - origin) / direction;
  const float b = (high - origin) / direction;
  interval.begin = std::max(interval.begin, std::min(a, b));
  interval.end = std::min(interval.end, std::max(a, b));
}

/// Searches pixels of a reference along their epipolar lines in one other frame.
class EpipolarSearch {
 public:
  EpipolarSearch(const Map& map, std::size_t frame, const PinholeCamera& camera)
      : reference_(map.frames.front().frame->level(0)),
        target_(map.frames[frame].frame->level(0)),
        pose_(map.pose(frame)),
        covariance_(*map.frames[frame].covariance),
        transfer_(brightnessTransfer({},
                                     map.frames.front().frame->exposure(),
                                     map.frames[frame].affine,
                                     map.frames[frame].frame->exposure())),
        camera_(camera),
        geometry_(camera, pose_) {}

  /// Adds a trustworthy match within kSearchSigmas, with the variance of [Gladkova], eq. (8), where
  /// the line is in the image, the gradient not across it, and the motion large enough.
  void search(const Eigen::Vector2f& pixel, FusedDepth& depth) const {
    const DepthEstimate prior = depth.current;
    const auto line = EpipolarLine::through(geometry_, pixel, prior.inverse_depth);
    // The floor of the line's error limits what this frame can tell.
    if (!line || line->speed * std::sqrt(prior.variance) < kLineErrorFloor) return;
    const ImageSample here =
        reference_.at(static_cast<int>(pixel.x()), static_cast<int>(pixel.y()));
    const Eigen::Vector2f gradient =
        line->warp.inverse().transpose() * Eigen::Vector2f(here.dx, here.dy);
    const float along = std::abs(gradient.dot(line->direction));
    if (!(along >= std::max(kMinLineGradient, kMinGradientShare * gradient.norm()))) {
      return;
    }
    const Patch patch = cutPatch(pixel, *line);
    const Interval interval = clippedInterval(patch, prior);
    if (!(interval.end - interval.begin >= 2.0F)) return;
    ++depth.searches;
    const std::optional<float> best = bestStep(patch, interval);
    const std::optional<Match> match = best ? refine(patch, interval, *best) : std::nullopt;
    if (!match) return;
    const auto [inverse_depth, alpha] = line->depthAt(match->position);
    const Eigen::Vector3d ray = camera_.unproject(pixel.cast<double>());
    const auto projection = projectHosted(camera_, pose_, ray, inverse_depth);
    if (!projection) return;
    const float photometric = 2.0F * kImageNoise * kImageNoise / match->information;  // eq. (7)
    const float variance =
        alpha * alpha * (geometricVariance(*line, projection->J_pose, *match) + photometric);
    if (!(inverse_depth > 0) || !std::isfinite(variance) || !(variance > 0)) return;
    depth.add({inverse_depth, variance});
  }

 private:
  [[nodiscard]] Patch cutPatch(const Eigen::Vector2f& pixel, const EpipolarLine& line) const {
    Patch patch{line, {}, {}};
    for (std::size_t i = 0; i < kPatternSize; ++i) {
      const float grey = reference_.intensity(static_cast<int>(pixel.x()) + kPattern[i].x,
                                              static_cast<int>(pixel.y()) + kPattern[i].y);
      patch.grey[i] =
          static_cast<float>(transfer_.gain) * grey + static_cast<float>(transfer_.offset);
      patch.offset[i] = line.warp * Eigen::Vector2f(static_cast<float>(kPattern[i].x),
                                                    static_cast<float>(kPattern[i].y));
      patch.extent = std::max(patch.extent, patch.offset[i].lpNorm<Eigen::Infinity>());
    }
    return patch;
  }

  [[nodiscard]] Interval clippedInterval(const Patch& patch, const DepthEstimate& prior) const {
    const EpipolarLine& line = patch.line;
    const auto longest =
        static_cast<float>(0.5 * kMaxSearch * std::hypot(camera_.width, camera_.height));
    const float reach = kSearchSigmas * std::sqrt(prior.variance);
    const float low =
        line.positionOf(std::max(prior.inverse_depth - reach, 0.0F)).value_or(-longest);
    const float high = line.positionOf(prior.inverse_depth + reach).value_or(longest);
    Interval interval{std::clamp(low, -longest, -kMinHalfLength),
                      std::clamp(high, kMinHalfLength, longest)};
    clip(line.origin.x(), line.direction.x(), patch.extent, target_.width(), interval);
    clip(line.origin.y(), line.direction.y(), patch.extent, target_.height(), interval);
    return interval;
  }

  /// @return position of the best step; nothing when there is none or another is about as good
  [[nodiscard]] std::optional<float> bestStep(const Patch& patch, const Interval& interval) const {
    constexpr float kMax = std::numeric_limits<float>::max();
    const int steps = static_cast<int>(interval.end - interval.begin) + 1;
    std::vector<float> costs;
    int best = -1;
    float best_cost = kMax;
    for (int i = 0; i < steps; ++i) {
      costs.push_back(linearize(patch, interval.begin + static_cast<float>(i)).squared_error);
      if (!(costs.back() < best_cost)) continue;  // never true for an invalid pixel's NaN
      best_cost = costs.back();
      best = i;
    }
    if (best < 0) return std::nullopt;
    const auto at = [&](int i) {
      return i >= 0 && i < steps ? costs[static_cast<std::size_t>(i)] : kMax;
    };
    // Differences below the noise tell nothing.
    const float limit =
        kSecondBestRatio * std::max(best_cost, kPatternSize * kImageNoise * kImageNoise);
    for (int i = 0; i < steps; ++i) {
      const bool other = std::abs(i - best) > kNeighbourhood;
      if (other && at(i) < limit && at(i) <= at(i - 1) && at(i) <= at(i + 1)) return std::nullopt;
    }
    return interval.begin + static_cast<float>(best);
  }

  [[nodiscard]] Match linearize(const Patch& patch, float position) const {
    Match sums;
    sums.position = position;
    const Eigen::Vector2f centre = patch.line.at(position);
    for (std::size_t i = 0; i < kPatternSize; ++i) {
      const Eigen::Vector2f at = centre + patch.offset[i];
      const Sample<float> sample = interpolate(target_, at.x(), at.y());
      const Eigen::Vector2f gradient(sample.dx, sample.dy);
      const float difference = sample.intensity - patch.grey[i];
      const float along = gradient.dot(patch.line.direction);
      sums.squared_error += difference * difference;
      sums.gradient += along * difference;
      sums.information += along * along;
      sums.cross += along * gradient;
    }
    return sums;
  }

  [[nodiscard]] std::optional<Match> refine(const Patch& patch,
                                            const Interval& interval,
                                            float best) const {
    const float begin = std::max(interval.begin, best - kMaxShift);
    const float end = std::min(interval.end, best + kMaxShift);
    Match match = linearize(patch, best);
    for (int i = 0; i < kRefinements; ++i) {
      if (!(match.information >= kMinLineGradient * kMinLineGradient)) return std::nullopt;
      const float step = -match.gradient / match.information;
      const float position = match.position + step;
      if (!(position >= begin && position <= end)) return std::nullopt;
      const Match moved = linearize(patch, position);
      if (!(moved.squared_error <= match.squared_error)) break;
      match = moved;
      if (std::abs(step) < kSettled) break;
    }
    const bool fits = match.squared_error <= kPatternSize * kMaxResidual * kMaxResidual;
    return fits ? std::optional(match) : std::nullopt;
  }

  /// Variance of a match along its line [px^2]: eq. (6), with sigma_l from the covariance of the
  /// pose. A displacement d of the line moves the match by -shift . d; for one gradient direction g
  /// of unit length shift = g / <g, l>. The line's error is taken to be the same in all directions
  /// as it is across the line.
  [[nodiscard]] float geometricVariance(const EpipolarLine& line,
                                        const Eigen::Matrix<double, 2, 6>& J_pose,
                                        const Match& match) const {
    const Eigen::Matrix2d position_covariance = J_pose * covariance_ * J_pose.transpose();
    const Eigen::Vector2d normal(static_cast<double>(-line.direction.y()),
                                 static_cast<double>(line.direction.x()));
    const auto sigma_squared = static_cast<float>(normal.dot(position_covariance * normal));
    const Eigen::Vector2f shift = match.cross / match.information;
    return std::max(sigma_squared, kLineErrorFloor * kLineErrorFloor) * shift.squaredNorm();
  }

  const PyramidLevel& reference_;
  const PyramidLevel& target_;
  SE3 pose_;
  Matrix6d covariance_;
  BrightnessTransfer transfer_;
  PinholeCamera camera_;
  EpipolarGeometry geometry_;
};

}  // namespace

void populateStructure3D(Map& map, const PinholeCamera& camera, std::uint64_t seed) {
  // The search needs brightness, which the thesis leaves open.
  init_orb::InitialMap corners = cornersOf(map);
  init_orb::estimateBrightness(corners, camera);
  map.frames = std::move(corners.frames);
  const std::vector<SelectedPixel> selected = selectCandidates(*map.frames.front().frame, seed);
  const CornerPrior prior(map, camera);
  std::vector<EpipolarSearch> frames;
  for (std::size_t k = 1; k < map.frames.size(); ++k) frames.emplace_back(map, k, camera);
  std::vector<FusedDepth> depths(selected.size());
  const auto pixelOf = [&](std::size_t i) {
    return Eigen::Vector2f(static_cast<float>(selected[i].x), static_cast<float>(selected[i].y));
  };
  forEachRange(depths.size(), kTaskGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      depths[i].current = prior.at(pixelOf(i));
      for (const EpipolarSearch& frame : frames) frame.search(pixelOf(i), depths[i]);
    }
  });
  map.points.resize(map.corners);
  for (std::size_t i = 0; i < depths.size(); ++i) {
    const FusedDepth& depth = depths[i];
    if (depth.observations == 0 || depth.votes >= kMaxVotes) continue;
    const DepthEstimate& fused = depth.current;
    map.points.push_back({pixelOf(i), fused.inverse_depth, fused.variance, depth.observations});
  }
}

}  // namespace dsorb::published
