// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/map/initial_map.h"

#include "base/erase_marked.h"
#include "base/parallel.h"
#include "estimate/robust_loss.h"
#include "estimate/rolling_shutter.h"
#include "estimate/sampling.h"
#include "image/contrast.h"
#include "image/frame_priors.h"
#include "image/photometric.h"
#include "init/result.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <utility>

namespace dsorb::init_orb {
namespace {

bool handedOver(double inverse_depth, double variance) {
  return std::isfinite(inverse_depth) && inverse_depth > 0 && std::isfinite(variance) &&
         variance > 0;
}

/// Makes this inverse depth 1. @return false when it is not positive
bool rescale(InitialMap& map, double mean) {
  if (!(mean > 0) || !std::isfinite(mean)) return false;
  for (Corner& corner : map.corners) {
    changeUnit(mean, corner.inverse_depth, corner.variance);
    changeUnit(mean, corner.known.mean, corner.known.variance);
  }
  for (InitPoint& point : map.points) changeUnit(mean, point.inverse_depth, point.variance);
  changeUnit(mean, map.frames);
  map.metres /= mean;
  for (FrameMotion& motion : map.motions) {
    motion.found.changeUnit(mean);
    motion.prior.changeUnit(mean);
  }
  for (Eigen::Index row = 0; row < map.joint_covariance.rows(); ++row) {
    if (row % 6 >= 3) continue;  // a rotation
    map.joint_covariance.row(row) *= mean;
    map.joint_covariance.col(row) *= mean;
  }
  return true;
}

constexpr int kRadius = 4;           // of a pixel without depth [px]
constexpr double kGuessSigma = 0.1;  // least relative standard deviation there [-]

/// Weighted sums over known pixels.
struct Sums {
  double weight = 0;
  double mean = 0;
  double square = 0;
  double claimed = 0;  // variances

  void add(double inverse_depth, double variance, double w) {
    weight += w;
    mean += w * inverse_depth;
    square += w * inverse_depth * inverse_depth;
    claimed += w * variance;
  }
  [[nodiscard]] double average() const { return mean / weight; }
  [[nodiscard]] double spread() const {
    return std::max(0.0, square / weight - average() * average());
  }
};

Sums sumAround(const DepthPrior& prior, int x, int y, int radius) {
  Sums sums;
  for (int v = std::max(0, y - radius); v <= std::min(prior.height - 1, y + radius); ++v) {
    for (int u = std::max(0, x - radius); u <= std::min(prior.width - 1, x + radius); ++u) {
      const auto i = static_cast<std::size_t>(v) * static_cast<std::size_t>(prior.width) +
                     static_cast<std::size_t>(u);
      if (!isKnownDepth(prior.depth[i])) continue;
      const auto depth = static_cast<double>(prior.depth[i]);
      const double sigma = static_cast<double>(prior.sigma[i]) / (depth * depth);
      sums.add(1 / depth, sigma * sigma, 1 / (1 + std::hypot(u - x, v - y)));
    }
  }
  return sums;
}

constexpr int kMinPairs = 10;
constexpr int kIterations = 5;  // of re-weighting
constexpr double kMaxGain = 5;  // and its inverse; more is no exposure change

/// Mean grey value of the residual pattern; nullopt where it leaves the image or is invalid.
std::optional<double> patchMean(const PyramidLevel& level, const Eigen::Vector2f& at) {
  if (!canSample(level, at.x(), at.y(), kPatternRadius)) return std::nullopt;
  float sum = 0;
  for (const PatternOffset& offset : kPattern) {
    sum += interpolateIntensity(
        level, at.x() + static_cast<float>(offset.x), at.y() + static_cast<float>(offset.y));
  }
  if (!std::isfinite(sum)) return std::nullopt;
  return static_cast<double>(sum) / kPatternSize;
}

struct GreyPair {
  double reference;
  double target;
};

/// target = gain reference + offset, Huber weights.
std::optional<BrightnessTransfer> fitLine(const std::vector<GreyPair>& pairs) {
  if (pairs.size() < kMinPairs) return std::nullopt;
  BrightnessTransfer line;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    GreyLine sums;
    for (const GreyPair& pair : pairs) {
      const double error = pair.target - line.gain * pair.reference - line.offset;
      // The first round has no line yet.
      const double weight =
          iteration == 0 ? 1.0 : static_cast<double>(huberWeight(static_cast<float>(error)));
      sums.add(pair.reference, pair.target, weight);
    }
    const auto fitted = sums.transfer();
    if (!fitted) return std::nullopt;
    line = *fitted;
  }
  return line.gain > 1 / kMaxGain && line.gain < kMaxGain ? std::optional(line) : std::nullopt;
}

/// Brightness of a frame whose reference has none; none either where nothing can be said.
AffineBrightness affineOf(const Frame& reference,
                          const Frame& frame,
                          const std::vector<GreyPair>& pairs) {
  const std::optional<BrightnessTransfer> line = fitLine(pairs);
  if (!line) return {};
  const double exposure_ratio =
      brightnessTransfer({}, reference.exposure(), {}, frame.exposure()).gain;
  return {std::log(line->gain / exposure_ratio), line->offset};
}

/// Where the rows of its frame show a corner [px].
Eigen::Vector2f shownPixel(const InitialMap& map,
                           const PinholeCamera& camera,
                           const CornerObservation& observation,
                           const std::optional<RollingShutter>& shutter) {
  Eigen::Vector2f pixel = observation.pixel.cast<float>();
  if (!shutter) return pixel;
  const Corner& corner = map.corners[observation.corner];
  const SE3& T_cam_ref = *map.frames[observation.frame].T_cam_ref;
  const Eigen::Vector3d direction = T_cam_ref.unitQuaternion() * camera.unproject(corner.pixel) +
                                    corner.inverse_depth * T_cam_ref.translation();
  return pixelInRow(
      *shutter, camera, pixel, static_cast<float>(corner.inverse_depth / direction.z()));
}

}  // namespace

KnownTerm knownTerm(const KnownInverseDepth& known, double inverse_depth) {
  const double error = (inverse_depth - known.mean) / std::sqrt(known.variance);
  const double ratio = cauchyRatio(error * error, kCauchyLimit);
  const double weight = 1 / ratio;
  return {weight / known.variance,
          weight * error / std::sqrt(known.variance),
          0.5 * kCauchyLimit * kCauchyLimit * std::log(ratio),
          weight * error * error};
}

BrightnessTransfer brightnessTo(const InitialMap& map, std::size_t frame) {
  const PosedFrame& from = map.frames.front();
  const PosedFrame& to = map.frames[frame];
  return brightnessTransfer(from.affine, from.frame->exposure(), to.affine, to.frame->exposure());
}

std::optional<RollingShutter> shutterOf(const InitialMap& map, std::size_t frame) {
  if (map.motions.empty()) return std::nullopt;
  const Frame& of = *map.frames[frame].frame;
  const double change = map.readout ? map.readout->seconds - readoutOf(of).seconds : 0;
  return makeRollingShutter(rowTimesOf(of, change), map.motions[frame].found);
}

void placeCorners(InitialMap& map, const PinholeCamera& camera) {
  const std::optional<RollingShutter> shutter = shutterOf(map, 0);
  if (!shutter) return;
  for (Corner& corner : map.corners) {
    const Eigen::Vector2d seen = corner.pixel + corner.shift;
    corner.pixel =
        pixelInMiddle(
            *shutter, camera, seen.cast<float>(), static_cast<float>(corner.inverse_depth))
            .cast<double>();
    corner.shift = seen - corner.pixel;
  }
}

void setJointCovariance(InitialMap& map,
                        std::vector<std::size_t> frames,
                        const Eigen::MatrixXd& joint) {
  map.joint_frames = std::move(frames);
  map.joint_covariance = joint;
  Eigen::Index row = 0;
  for (const std::size_t frame : map.joint_frames) {
    map.frames[frame].covariance = joint.block<6, 6>(row, row);
    row += 6;
  }
}

void widenCovariances(InitialMap& map, double factor) {
  const double variance = factor * factor;
  setJointCovariance(map, map.joint_frames, variance * map.joint_covariance);
  for (Corner& corner : map.corners) corner.variance *= variance;
}

void removeCorners(InitialMap& map, const std::vector<char>& removed) {
  std::vector<std::size_t> new_index;
  new_index.reserve(removed.size());
  std::size_t next = 0;
  for (const char gone : removed) new_index.push_back(gone == 0 ? next++ : next);
  eraseMarked(removed, map.corners);
  std::size_t kept = 0;
  for (const CornerObservation& observation : map.observations) {
    if (removed[observation.corner] != 0) continue;
    map.observations[kept] = observation;
    map.observations[kept++].corner = new_index[observation.corner];
  }
  map.observations.resize(kept);
}

std::vector<InitPoint> pointsOf(const InitialMap& map) {
  std::vector<int> observations(map.corners.size(), 0);
  for (const CornerObservation& observation : map.observations) {
    ++observations[observation.corner];
  }
  std::vector<InitPoint> points;
  for (std::size_t i = 0; i < map.corners.size(); ++i) {
    const Corner& corner = map.corners[i];
    if (!handedOver(corner.inverse_depth, corner.variance)) continue;
    points.push_back({0,
                      corner.seen(),
                      static_cast<float>(corner.inverse_depth),
                      static_cast<float>(corner.variance),
                      observations[i]});
  }
  for (const InitPoint& point : map.points) {
    if (handedOver(point.inverse_depth, point.variance)) points.push_back(point);
  }
  return points;
}

bool normalizeCornerScale(InitialMap& map) {
  double mean = 0;
  for (const Corner& corner : map.corners) {
    mean += corner.inverse_depth / static_cast<double>(map.corners.size());
  }
  return rescale(map, mean);
}

KnownInverseDepth DepthLookup::at(const Eigen::Vector2f& pixel) const {
  const auto x = static_cast<int>(std::lround(pixel.x()));
  const auto y = static_cast<int>(std::lround(pixel.y()));
  const Sums own = sumAround(prior_, x, y, 0);
  const Sums around = sumAround(prior_, x, y, own.weight > 0 ? 1 : kRadius);
  if (!(around.weight > 0)) return {};
  const Sums& best = own.weight > 0 ? own : around;
  double variance = inflation_ * inflation_ * best.claimed / best.weight + around.spread();
  if (!(own.weight > 0)) {
    const double guess = kGuessSigma * best.average();
    variance += guess * guess;
  }
  return {metres_ * best.average(), metres_ * metres_ * variance};
}

void estimateBrightness(InitialMap& map, const PinholeCamera& camera) {
  const Frame& reference = *map.frames.front().frame;
  std::vector<std::optional<double>> host(map.corners.size());
  forEachRange(host.size(), kTaskGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      host[i] = patchMean(reference.level(0), map.corners[i].seen());
    }
  });
  forEachRange(map.frames.size() - 1, 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t k = begin + 1; k <= end; ++k) {
      PosedFrame& posed = map.frames[k];
      const std::optional<RollingShutter> shutter = shutterOf(map, k);
      std::vector<GreyPair> pairs;
      for (const CornerObservation& seen : map.observations) {
        if (seen.frame != k || !posed.T_cam_ref || !host[seen.corner]) continue;
        const auto target =
            patchMean(posed.frame->level(0), shownPixel(map, camera, seen, shutter));
        if (target) pairs.push_back({*host[seen.corner], *target});
      }
      posed.affine = affineOf(reference, *posed.frame, pairs);
    }
  });
}

}  // namespace dsorb::init_orb
