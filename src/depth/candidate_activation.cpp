// SPDX-License-Identifier: BSD-3-Clause
#include "depth/candidate_activation.h"

#include "base/parallel.h"
#include "base/target_clones.h"
#include "estimate/robust_loss.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

namespace dsorb::depth {
namespace {

using Eigen::Vector2f;
using Eigen::Vector3f;

// Constants as published with DSO (Engel et al., arXiv:1607.02565) unless noted.
constexpr double kMaxSearchShare = 0.027;  // longest search, relative to width + height
constexpr float kMinInterval = 1.5F;       // [px] shorter epipolar intervals are not searched again
constexpr float kMaxError = 10;            // [px] the expected error is limited to this
constexpr float kMinDepthRatio = 0.75F;    // admissible depth in the frame over depth in the host
constexpr float kMaxDepthRatio = 1.5F;
constexpr float kNearestRatio = 0.4F;     // the same where frames are far apart
constexpr int kRefinementIterations = 3;  // Gauss-Newton along the line
constexpr float kOutlierSlack = 1.2F;     // on the patch energy that makes a match an outlier
constexpr float kDirectionInverseDepth = 0.01F;  // [1/unit] fixes the direction of a first search
constexpr float kBaseError = 0.2F;               // [px] discretisation, and factor of the geometry
constexpr float kInvalidEnergy = 1e5F;           // of one pixel without value
constexpr int kMaxPositions = 330;               // 1 px apart: kMaxSearchShare of 7680x4320
constexpr int kSecondBestDistance = 2;           // [px] the second best is farther away than this
constexpr int kQualityReset = 10;                // searches over more positions replace the quality
constexpr float kMaxRefinementStep = 0.5F;       // [px]
constexpr float kMinRefinementStep = 0.1F;       // [px]

/// The pattern as seen in the frame: offsets and expected intensities.
struct ExpectedPattern {
  Lanes x, y;
  Lanes intensity;
  float extent_x = 0;  // [px]
  float extent_y = 0;
  Vector2f shift{0, 0};  // to the rows of the frame, part of x and y [px]

  void moveBy(const Vector2f& to_rows) {
    shift = to_rows;
    x += shift.x();
    y += shift.y();
    extent_x += std::abs(shift.x());
    extent_y += std::abs(shift.y());
  }
};

/// Shift from a place on the epipolar line to where the row of the frame shows it [px].
Vector2f shiftToRow(const CandidatePoint& candidate,
                    const EpipolarPair& pair,
                    float inverse_depth) {
  const Vector2f ray = pair.rays.at(candidate.patch.pixel);
  WarpedPoint<float> p = warpPoint(pair.warp, ray.x(), ray.y(), inverse_depth);
  if (!p.front) return {0, 0};
  const Vector2f middle(p.x, p.y);
  moveToRow(*pair.shutter, pair.warp, inverse_depth * p.inverse_z, p);
  return Vector2f(p.x, p.y) - middle;
}

/// Interval of inverse depths to search before the first match.
struct Expectation {
  bool counts = false;
  float min = 0;
  float max = 0;
  float scale = 1;  ///< of the host's patch in the frame
};

/// What the points around let expect; it counts where frames are so far apart that a search of the
/// usual length, from infinity, would not reach all of it.
Expectation expectationOf(const CandidatePoint& candidate,
                          const EpipolarPair& pair,
                          float longest) {
  if (candidate.hasDepth() || !std::isfinite(candidate.expected_max)) return {};
  const Vector2f& pixel = candidate.patch.pixel;
  const Vector3f infinity = pair.geometry.atInfinity(pixel);
  Expectation expected{true, candidate.expected_min, candidate.expected_max};
  if (pair.geometry.b.z() < 0) {
    expected.max = std::min(expected.max, (kNearestRatio - infinity.z()) / pair.geometry.b.z());
  }
  if (!(expected.min < expected.max)) return {};
  const Vector3f nearest = pair.geometry.at(pixel, expected.max);
  if (!(infinity.z() > 0 && nearest.z() > 0)) return {};
  const float parallax = (infinity.hnormalized() - nearest.hnormalized()).norm();
  if (!(parallax > longest)) return {};
  expected.scale = 1 / pair.geometry.at(pixel, 0.5F * (expected.min + expected.max)).z();
  return expected;
}

/// @param scale of the host's patch in the frame
ExpectedPattern expectPattern(const CandidatePoint& candidate,
                              const EpipolarPair& pair,
                              float scale) {
  ExpectedPattern warped;
  for (std::size_t k = 0; k < kPattern.size(); ++k) {
    const Vector2f offset(static_cast<float>(kPattern[k].x), static_cast<float>(kPattern[k].y));
    const Vector2f turned = scale * (pair.geometry.A.topLeftCorner<2, 2>() * offset);
    warped.x[k] = turned.x();
    warped.y[k] = turned.y();
    warped.extent_x = std::max(warped.extent_x, std::abs(turned.x()));
    warped.extent_y = std::max(warped.extent_y, std::abs(turned.y()));
    warped.intensity[k] = pair.gain * candidate.patch.grey[k] + pair.offset;
  }
  if (pair.shutter) {
    const float depth = candidate.hasDepth() ? candidate.middle() : kDirectionInverseDepth;
    warped.moveBy(shiftToRow(candidate, pair, depth));
  }
  return warped;
}

/// The discrete search begins up to this before its segment and ends as far behind [px].
constexpr float kSearchSlack = 1;
constexpr float kClipSlack = 1e-3F;  // of a clipped line's ends to the border, of its length

float longestSearch(const PyramidLevel& level) {
  return static_cast<float>(kMaxSearchShare * static_cast<double>(level.width() + level.height()));
}

/// Part of the image where the pattern can be sampled up to `slack` pixels further on.
struct SearchArea {
  float low_x, low_y, high_x, high_y;
  float longest;  ///< search

  SearchArea(const PyramidLevel& level, const ExpectedPattern& pattern, float slack)
      : low_x(kNearBorder + kLineRounding + slack + pattern.extent_x),
        low_y(kNearBorder + kLineRounding + slack + pattern.extent_y),
        high_x(static_cast<float>(level.width()) - kFarBorder - kLineRounding - slack -
               pattern.extent_x),
        high_y(static_cast<float>(level.height()) - kFarBorder - kLineRounding - slack -
               pattern.extent_y),
        longest(longestSearch(level)) {}

  [[nodiscard]] bool contains(const Vector2f& p) const {
    return p.x() > low_x && p.y() > low_y && p.x() < high_x && p.y() < high_y;
  }

  /// Shortens a line to its part in here; one that has none is left as it is.
  void clip(Vector2f& start, Vector2f& line) const {
    float from = 0;
    float to = 1;
    const auto keep = [&](float low, float high, float at, float along) {
      if (along == 0) return;
      const float enters = ((along > 0 ? low : high) - at) / along;
      const float leaves = ((along > 0 ? high : low) - at) / along;
      from = std::max(from, enters + kClipSlack);
      to = std::min(to, leaves - kClipSlack);
    };
    keep(low_x, high_x, start.x(), line.x());
    keep(low_y, high_y, start.y(), line.y());
    if (!(from < to) || (from <= 0 && to >= 1)) return;
    start += from * line;
    line *= to - from;
  }
};

/// The stretch of epipolar line to search.
struct Segment {
  Vector2f near{0, 0};
  Vector2f direction{0, 0};  // unit, from near to far
  float length = 0;          // [px]
  float error = 0;           // expected of a match [px]
};

void fail(CandidatePoint& candidate, CandidateStatus status) {
  candidate.status = status;
  candidate.interval = 0;
}

void leave(CandidatePoint& candidate, const DepthOptions& options) {
  fail(candidate, CandidateStatus::kOutOfBounds);
  candidate.finished = options.published;
}

void rejectMatch(CandidatePoint& candidate) {
  const bool again = candidate.status == CandidateStatus::kOutlier;
  fail(candidate, again ? CandidateStatus::kOutOfBounds : CandidateStatus::kOutlier);
  candidate.finished = again;
}

/// Expected error of a match: discretisation, and more the less gradient lies along the line.
float expectedError(const CandidatePoint& candidate,
                    const EpipolarPair& pair,
                    const Vector2f& direction,
                    const DepthOptions& options) {
  Vector2f in_host = direction;
  if (!options.published) {
    in_host = pair.geometry.A.topLeftCorner<2, 2>().inverse() * direction;
    in_host.normalize();
  }
  const Vector3f& s = candidate.structure;
  const float along = in_host.x() * in_host.x() * s[0] + 2 * in_host.x() * in_host.y() * s[1] +
                      in_host.y() * in_host.y() * s[2];
  const float across = in_host.y() * in_host.y() * s[0] - 2 * in_host.x() * in_host.y() * s[1] +
                       in_host.x() * in_host.x() * s[2];
  return kBaseError + kBaseError * (along + across) / along;
}

/// Where to search. @return nullopt when the candidate's status is decided without a search
std::optional<Segment> planSearch(CandidatePoint& candidate,
                                  const EpipolarPair& pair,
                                  const SearchArea& area,
                                  const DepthOptions& options,
                                  const Expectation& expected) {
  const bool known = candidate.hasDepth();
  const Vector3f near = pair.geometry.at(
      candidate.patch.pixel, expected.counts ? expected.min : candidate.min_inverse_depth);
  Segment segment;
  segment.near = near.hnormalized();
  const float far_depth = known ? candidate.max_inverse_depth : kDirectionInverseDepth;
  const Vector3f far =
      pair.geometry.at(candidate.patch.pixel, expected.counts ? expected.max : far_depth);
  Vector2f line = Vector2f(far.hnormalized()) - segment.near;
  if (!known && !expected.counts) line *= area.longest / line.norm();
  if (expected.counts) area.clip(segment.near, line);
  segment.length = line.norm();
  const bool ends_inside = near.z() > 0 && far.z() > 0 && area.contains(segment.near) &&
                           area.contains(segment.near + line);  // false for NaN as well
  if (!ends_inside) {
    leave(candidate, options);
    return std::nullopt;
  }
  if (known && segment.length < kMinInterval) {
    candidate.status = CandidateStatus::kSkipped;
    candidate.interval = segment.length;
    return std::nullopt;
  }
  const bool ratio_ok = expected.counts || (near.z() > kMinDepthRatio && near.z() < kMaxDepthRatio);
  if (!ratio_ok && !(candidate.min_inverse_depth < 0)) {
    leave(candidate, options);
    return std::nullopt;
  }
  segment.direction = line / segment.length;
  segment.error = expectedError(candidate, pair, segment.direction, options);
  const auto min_improvement = static_cast<float>(options.min_improvement);
  if (known && min_improvement * segment.error > segment.length) {
    candidate.status = CandidateStatus::kIllConditioned;
    candidate.interval = segment.length;
    return std::nullopt;
  }
  segment.error = std::min(segment.error, kMaxError);
  if (!expected.counts) segment.length = std::min(segment.length, area.longest);
  return segment;
}

DSORB_ALWAYS_INLINE float patchEnergy(const PyramidLevel& level,
                                      const ExpectedPattern& pattern,
                                      const Vector2f& at) {
  const Lanes seen =
      interpolateIntensities(level.data(), level.width(), at.x() + pattern.x, at.y() + pattern.y);
  const Lanes residual = seen - pattern.intensity;
  const Lanes energy = huberEnergies(residual, huberWeights(residual));
  const auto invalid = spread<Lanes>(kInvalidEnergy);
  return sumLanes(energy < invalid ? energy : invalid);  // NaN is invalid
}

/// Best of positions 1 px apart; updates the quality.
DSORB_TARGET_CLONES Vector2f searchDiscrete(CandidatePoint& candidate,
                                            const Segment& segment,
                                            const PyramidLevel& level,
                                            const ExpectedPattern& pattern) {
  const int positions = std::min(static_cast<int>(1.9999F + segment.length), kMaxPositions);
  const float varied = segment.near.x() * 1000;  // sub-pixel phase that differs between candidates
  const float phase = varied - std::floor(varied);
  const Vector2f start = segment.near - phase * segment.direction;
  std::array<float, kMaxPositions> energies{};
  int best = 0;
  for (int i = 0; i < positions; ++i) {
    const auto slot = static_cast<std::size_t>(i);
    energies[slot] = patchEnergy(level, pattern, start + static_cast<float>(i) * segment.direction);
    if (energies[slot] < energies[static_cast<std::size_t>(best)]) best = i;
  }
  float second = kInvalidEnergy * kPatternSize;
  for (int i = 0; i < positions; ++i) {
    if (std::abs(i - best) > kSecondBestDistance) {
      second = std::min(second, energies[static_cast<std::size_t>(i)]);
    }
  }
  const float quality = second / energies[static_cast<std::size_t>(best)];
  if (quality < candidate.quality || positions > kQualityReset) candidate.quality = quality;
  return start + static_cast<float>(best) * segment.direction;
}

/// Sums over the pattern at a position of the line, where it can be sampled.
struct LineTerms {
  float energy = INFINITY;  // where the pattern leaves the image or meets an invalid pixel
  float curvature = 1;      // regularised
  float gradient = 0;
};

DSORB_ALWAYS_INLINE LineTerms lineTerms(const CandidatePoint& candidate,
                                        const Vector2f& at,
                                        const Vector2f& direction,
                                        const PyramidLevel& level,
                                        const ExpectedPattern& pattern) {
  LineTerms terms;
  const Lanes host_weight = load(candidate.patch.root_weight.data());
  const LaneSamples seen =
      interpolateLanes(level.data(), level.width(), at.x() + pattern.x, at.y() + pattern.y);
  const Lanes residual = seen.intensity - pattern.intensity;
  const Lanes slope = seen.dx * direction.x() + seen.dy * direction.y();
  const Lanes weight = huberWeights(residual);
  const float energy =
      sumLanes(huberEnergies<Lanes>(residual, weight, host_weight * host_weight * weight));
  if (!std::isfinite(energy)) return terms;
  terms.energy = energy;
  terms.curvature += sumLanes(weight * slope * slope);
  terms.gradient = sumLanes(weight * residual * slope);
  return terms;
}

struct Match {
  Vector2f pixel{0, 0};
  float energy = kInvalidEnergy;
};

/// Gauss-Newton along the line from the segment's near end; a step that raises the energy is
/// halved.
DSORB_TARGET_CLONES Match refineMatch(const CandidatePoint& candidate,
                                      const Segment& segment,
                                      const PyramidLevel& level,
                                      const ExpectedPattern& pattern) {
  const SearchArea area(level, pattern, 0);
  Match match{segment.near, kInvalidEnergy};
  Vector2f previous = segment.near;
  float step = 0;
  for (int i = 0; i < kRefinementIterations; ++i) {
    LineTerms terms;
    if (area.contains(match.pixel)) {
      terms = lineTerms(candidate, match.pixel, segment.direction, level, pattern);
    }
    if (terms.energy <= match.energy) {
      match.energy = terms.energy;
      step = -terms.gradient / terms.curvature;
      step = std::isfinite(step) ? std::clamp(step, -kMaxRefinementStep, kMaxRefinementStep) : 0;
      previous = match.pixel;
    } else {
      step *= 0.5F;
    }
    match.pixel = previous + step * segment.direction;
    if (std::abs(step) < kMinRefinementStep) break;
  }
  return match;
}

/// Inverse depth at which the point projects to a position of its epipolar line, from the axis
/// along which the line runs faster.
float inverseDepthAt(const Vector3f& infinity, const Vector3f& Kt, const Vector2f& p, bool use_x) {
  return use_x ? (infinity.z() * p.x() - infinity.x()) / (Kt.x() - Kt.z() * p.x())
               : (infinity.z() * p.y() - infinity.y()) / (Kt.y() - Kt.z() * p.y());
}

/// The rows' shift was taken at the middle of the interval; it is taken again at the match [px].
Vector2f rowCorrection(const CandidatePoint& candidate,
                       const EpipolarPair& pair,
                       const ExpectedPattern& pattern,
                       const Segment& segment,
                       const Match& match) {
  const bool use_x = std::abs(segment.direction.x()) > std::abs(segment.direction.y());
  const float depth = inverseDepthAt(
      pair.geometry.atInfinity(candidate.patch.pixel), pair.geometry.b, match.pixel, use_x);
  if (!std::isfinite(depth)) return {0, 0};
  return pattern.shift - shiftToRow(candidate, pair, depth);
}

void adoptMatch(CandidatePoint& candidate,
                const EpipolarPair& pair,
                const Segment& segment,
                const Vector2f& match) {
  const Vector3f infinity = pair.geometry.atInfinity(candidate.patch.pixel);
  const bool use_x = std::abs(segment.direction.x()) > std::abs(segment.direction.y());
  const Vector2f reach = segment.error * segment.direction;
  const float first = inverseDepthAt(infinity, pair.geometry.b, match - reach, use_x);
  const float second = inverseDepthAt(infinity, pair.geometry.b, match + reach, use_x);
  const bool usable = std::isfinite(first) && std::isfinite(second) && std::max(first, second) >= 0;
  if (!usable) {
    fail(candidate, CandidateStatus::kOutlier);
    return;
  }
  candidate.min_inverse_depth = std::min(first, second);
  candidate.max_inverse_depth = std::max(first, second);
  candidate.status = CandidateStatus::kGood;
  candidate.interval = 2 * segment.error;
}

// What a candidate needs to become a point of the window, as published with DSO.
constexpr float kMinQuality = 3;        // second best over best energy of the last long search
constexpr float kMaxInterval = 8;       // [px] uncertainty along the epipolar line
constexpr int kIterations = 3;          // of the depth alone, before activation
constexpr float kMinInformation = 100;  // [grey^2 unit^2] curvature of the energy a depth needs
constexpr int kMinObservations = 1;     // good residuals a depth needs

constexpr float kInitialDamping = 0.1F;  // of the depth fit, and its factors below
constexpr float kDampingOnSuccess = 0.5F;
constexpr float kDampingOnFailure = 5.0F;
constexpr float kRelativeStop = 1e-4F;  // of a step
constexpr float kLooseLimit = 1000.0F;  // factor on the first outlier limit (reference)

enum class FitState : std::uint8_t { kIn, kOutOfBounds, kOutlier };

/// Energy of the pattern with its derivatives by the inverse depth, of one target or several.
struct FitSums {
  float energy = 0;
  float curvature = 0;
  float gradient = 0;
  int inliers = 0;
};

/// @return nothing where the pattern cannot be seen
template <bool kRolling>
DSORB_ALWAYS_INLINE std::optional<FitSums> evaluateTarget(const CandidatePoint& candidate,
                                                          const HostRays& rays,
                                                          const TargetImage& target,
                                                          float inverse_depth) {
  const WarpedPattern pattern =
      warpPattern<kRolling>(target, rays, candidate.patch.pixel, inverse_depth);
  if (!inAllLanes(pattern.inside)) return std::nullopt;
  const Lanes weight = load(candidate.patch.root_weight.data());
  const Lanes residual = patternResidual(target, candidate.patch, pattern.seen);
  const Lanes huber = huberWeights(residual);
  const DepthFlow<Lanes> flow = depthFlow(target.warp, pattern.at);
  const Lanes slope = pattern.seen.dx * flow.x + pattern.seen.dy * flow.y;
  const Lanes w = weight * weight * huber;
  const float energy = sumLanes(huberEnergies(residual, huber, w));
  if (!std::isfinite(energy)) return std::nullopt;
  return FitSums{energy, sumLanes(w * slope * slope), sumLanes(w * slope * residual), 0};
}

/// A depth to try.
struct HypotheticalDepth {
  float inverse;         // [1/unit]
  float outlier_energy;  // of a target
};

/// Sum over all targets; `states` remembers which left the image for good.
template <bool kRolling>
DSORB_ALWAYS_INLINE FitSums sumTargetsAs(const CandidatePoint& candidate,
                                         const HostRays& rays,
                                         const std::vector<TargetImage>& targets,
                                         const HypotheticalDepth& depth,
                                         std::vector<FitState>& states) {
  FitSums sum;
  for (std::size_t i = 0; i < targets.size(); ++i) {
    if (states[i] == FitState::kOutOfBounds) continue;
    const auto terms = evaluateTarget<kRolling>(candidate, rays, targets[i], depth.inverse);
    if (!terms) {
      states[i] = FitState::kOutOfBounds;
      continue;
    }
    const bool outlier = terms->energy > depth.outlier_energy;
    states[i] = outlier ? FitState::kOutlier : FitState::kIn;
    sum.inliers += outlier ? 0 : 1;
    sum.energy += std::min(terms->energy, depth.outlier_energy);
    sum.curvature += terms->curvature;
    sum.gradient += terms->gradient;
  }
  return sum;
}

DSORB_TARGET_CLONES FitSums sumTargets(const CandidatePoint& candidate,
                                       const HostRays& rays,
                                       const std::vector<TargetImage>& targets,
                                       const HypotheticalDepth& depth,
                                       std::vector<FitState>& states) {
  const bool rolling = !targets.empty() && targets.front().corrected;
  return rolling ? sumTargetsAs<true>(candidate, rays, targets, depth, states)
                 : sumTargetsAs<false>(candidate, rays, targets, depth, states);
}

}  // namespace

void searchEpipolarLine(CandidatePoint& candidate,
                        const EpipolarPair& pair,
                        const PyramidLevel& level,
                        const DepthOptions& options) {
  if (candidate.finished) return;
  const Expectation expected = expectationOf(candidate, pair, longestSearch(level));
  const ExpectedPattern pattern = expectPattern(candidate, pair, expected.scale);
  const SearchArea area(level, pattern, kSearchSlack);
  std::optional<Segment> segment = planSearch(candidate, pair, area, options, expected);
  if (!segment) return;
  segment->near = searchDiscrete(candidate, *segment, level, pattern);
  Match match = refineMatch(candidate, *segment, level, pattern);
  if (!(match.energy < kOutlierSlack * kPatternOutlierEnergy)) {
    rejectMatch(candidate);
    return;
  }
  if (pair.shutter) match.pixel += rowCorrection(candidate, pair, pattern, *segment, match);
  adoptMatch(candidate, pair, *segment, match.pixel);
}

void searchEpipolarLines(std::vector<CandidatePoint>& candidates,
                         const EpipolarPair& pair,
                         const PyramidLevel& level,
                         const DepthOptions& options) {
  forEachRange(candidates.size(), kTaskGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      searchEpipolarLine(candidates[i], pair, level, options);
    }
  });
}

DistanceMap::DistanceMap(int width, int height, int reach)
    : width_(width),
      height_(height),
      reach_(reach),
      cells_(static_cast<std::size_t>(width) * static_cast<std::size_t>(height), kFar) {
  // One more than there are: growStep() writes before it knows.
  for (Front* front : {&front_, &next_}) front->cells.reset(new Cell[cells_.size() + 1]);
}

void DistanceMap::growStep(int distance) {
  static constexpr std::array<std::array<int, 2>, 8> kNeighbours = {
      {{1, 0}, {-1, 0}, {0, 1}, {0, -1}, {1, 1}, {1, -1}, {-1, 1}, {-1, -1}}};
  const std::size_t count = distance % 2 == 1 ? 8 : 4;
  Cell* reached = next_.cells.get();
  for (std::size_t i = 0; i < front_.size; ++i) {
    const Cell& cell = front_.cells[i];
    const bool border = cell.x == 0 || cell.y == 0 || cell.x == width_ - 1 || cell.y == height_ - 1;
    if (border) continue;
    for (std::size_t n = 0; n < count; ++n) {  // without a branch, which nobody could predict
      const auto [dx, dy] = kNeighbours[n];
      *reached = {cell.index + dy * width_ + dx, cell.x + dx, cell.y + dy};
      std::uint16_t& value = cells_[static_cast<std::size_t>(reached->index)];
      const bool nearer = value > distance;
      value = nearer ? static_cast<std::uint16_t>(distance) : value;
      reached += nearer ? 1 : 0;
    }
  }
  next_.size = static_cast<std::size_t>(reached - next_.cells.get());
  std::swap(front_, next_);
}

void DistanceMap::add(const std::vector<Eigen::Vector2i>& seeds) {
  front_.size = 0;
  for (const Eigen::Vector2i& seed : seeds) {
    std::uint16_t& value = cells_[index(seed.x(), seed.y())];
    if (value == 0) continue;  // grown from already
    value = 0;
    front_.cells[front_.size++] = {
        static_cast<std::int32_t>(index(seed.x(), seed.y())), seed.x(), seed.y()};
  }
  for (int distance = 1; distance <= reach_ && front_.size > 0; ++distance) growStep(distance);
}

double adaptDistance(double distance, int active, int desired, double max_distance) {
  const double ratio = static_cast<double>(active) / desired;
  if (ratio < 0.66) distance -= 0.8;
  if (ratio < 0.8) {
    distance -= 0.5;
  } else if (ratio < 0.9) {
    distance -= 0.2;
  } else if (ratio < 1.0) {
    distance -= 0.1;
  }
  if (ratio > 1.5) distance += 0.8;
  if (ratio > 1.3) distance += 0.5;
  if (ratio > 1.15) distance += 0.2;
  if (ratio > 1.0) distance += 0.1;
  return std::clamp(distance, 0.0, max_distance);
}

CandidateVerdict judgeCandidate(const CandidatePoint& candidate, bool host_leaves) {
  if (!candidate.hasDepth() || candidate.status == CandidateStatus::kOutlier) {
    return CandidateVerdict::kDrop;
  }
  const bool ready = candidate.status != CandidateStatus::kUninitialized &&
                     candidate.interval < kMaxInterval && candidate.quality > kMinQuality &&
                     candidate.middle() > 0;
  if (ready) return CandidateVerdict::kReady;
  return host_leaves || candidate.finished ? CandidateVerdict::kDrop : CandidateVerdict::kWait;
}

DepthFit fitDepth(const CandidatePoint& candidate,
                  const HostRays& rays,
                  const std::vector<TargetImage>& targets,
                  const DepthOptions& options) {
  const CandidateVerdict weak =
      candidate.finished ? CandidateVerdict::kDrop : CandidateVerdict::kWait;
  const float first_limit = kPatternOutlierEnergy * (options.published ? kLooseLimit : 1);
  std::vector<FitState> states(targets.size(), FitState::kIn);
  float depth = candidate.middle();
  FitSums terms = sumTargets(candidate, rays, targets, {depth, first_limit}, states);
  DepthFit fit;
  fit.verdict = weak;
  if (!std::isfinite(terms.energy) || terms.curvature < kMinInformation) return fit;
  // One number, which every trial may end for good: minimize() would need more around it than this.
  float damping = kInitialDamping;
  for (int i = 0; i < kIterations; ++i) {
    const float step = terms.gradient / ((1 + damping) * terms.curvature);
    std::vector<FitState> trial_states = states;
    const FitSums trial =
        sumTargets(candidate, rays, targets, {depth - step, kPatternOutlierEnergy}, trial_states);
    if (!std::isfinite(trial.energy) || trial.curvature < kMinInformation) return fit;
    if (trial.energy < terms.energy) {
      depth -= step;
      terms = trial;
      states = std::move(trial_states);
      damping *= kDampingOnSuccess;
    } else {
      damping *= kDampingOnFailure;
    }
    if (std::abs(step) < kRelativeStop * depth) break;
  }
  const bool good = std::isfinite(depth) && terms.inliers >= kMinObservations;
  fit.verdict = good ? CandidateVerdict::kReady : CandidateVerdict::kDrop;
  fit.inverse_depth = depth;
  fit.information = terms.curvature;
  for (const FitState state : states) fit.seen.push_back(state == FitState::kIn);
  return fit;
}

}  // namespace dsorb::depth
