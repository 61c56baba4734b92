// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/map/frame_brightness.h"

#include "base/parallel.h"
#include "estimate/robust_loss.h"
#include "estimate/rolling_shutter.h"
#include "estimate/sampling.h"
#include "image/photometric.h"

#include <cmath>
#include <numeric>
#include <optional>

namespace dsorb::init_orb {
namespace {

constexpr std::size_t kGrain = 256;  // patches one thread takes at a time
constexpr int kMinPairs = 10;
constexpr int kIterations = 5;      // of re-weighting
constexpr double kMinContrast = 5;  // standard deviation of the reference's patches [grey levels]
constexpr double kMaxGain = 5;      // and its inverse; more is no exposure change

/// Mean grey value of the residual pattern; nullopt where it leaves the image or is invalid.
std::optional<double> patchMean(const PyramidLevel& level, const Eigen::Vector2f& at) {
  if (!canSample(level, at.x(), at.y(), kPatternRadius)) {
    return std::nullopt;
  }
  float sum = 0;
  for (const PatternOffset& offset : kPattern) {
    sum += interpolateIntensity(
        level, at.x() + static_cast<float>(offset.x), at.y() + static_cast<float>(offset.y));
  }
  if (!std::isfinite(sum)) {
    return std::nullopt;
  }
  return static_cast<double>(sum) / kPatternSize;
}

struct GreyPair {
  double reference;
  double target;
};

/// target = gain reference + offset, Huber weights.
std::optional<BrightnessTransfer> fitLine(const std::vector<GreyPair>& pairs) {
  if (pairs.size() < kMinPairs) {
    return std::nullopt;
  }
  BrightnessTransfer line;
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    double sum = 0;
    double x = 0;
    double y = 0;
    double xx = 0;
    double xy = 0;
    for (const GreyPair& pair : pairs) {
      const double error = pair.target - line.gain * pair.reference - line.offset;
      // The first round has no line yet.
      const double weight =
          iteration == 0 ? 1.0 : static_cast<double>(huberWeight(static_cast<float>(error)));
      sum += weight;
      x += weight * pair.reference;
      y += weight * pair.target;
      xx += weight * pair.reference * pair.reference;
      xy += weight * pair.reference * pair.target;
    }
    const double variance = xx / sum - x / sum * (x / sum);
    if (!(variance > kMinContrast * kMinContrast)) {
      return std::nullopt;
    }
    line.gain = (xy / sum - x / sum * (y / sum)) / variance;
    line.offset = (y - line.gain * x) / sum;
  }
  if (!(line.gain > 1 / kMaxGain && line.gain < kMaxGain)) {
    return std::nullopt;
  }
  return line;
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
  const Eigen::Vector2f pixel = observation.pixel.cast<float>();
  if (!shutter) return pixel;
  const Corner& corner = map.corners[observation.corner];
  const SE3& T_cam_ref = *map.frames[observation.frame].T_cam_ref;
  const Eigen::Vector3d direction = T_cam_ref.unitQuaternion() * camera.unproject(corner.pixel) +
                                    corner.inverse_depth * T_cam_ref.translation();
  return pixelInRow(
      *shutter, camera, pixel, static_cast<float>(corner.inverse_depth / direction.z()));
}

}  // namespace

void estimateBrightness(InitialMap& map, const PinholeCamera& camera) {
  std::vector<std::size_t> all(map.frames.size() - 1);
  std::iota(all.begin(), all.end(), std::size_t{1});
  estimateBrightness(map, camera, all);
}

void estimateBrightness(InitialMap& map,
                        const PinholeCamera& camera,
                        const std::vector<std::size_t>& frames) {
  std::vector<std::optional<RollingShutter>> shutters(map.frames.size());
  for (const std::size_t frame : frames) shutters[frame] = shutterOf(map, frame);
  std::vector<char> wanted(map.frames.size(), 0);
  for (const std::size_t frame : frames) wanted[frame] = 1;
  std::vector<std::optional<double>> reference(map.corners.size());
  forEachRange(map.corners.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      reference[i] = patchMean(map.frames.front().frame->level(0), map.corners[i].seen());
    }
  });
  std::vector<std::optional<double>> target(map.observations.size());
  forEachRange(map.observations.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const CornerObservation& observation = map.observations[i];
      const auto frame = observation.frame;
      if (wanted[frame] != 0 && map.frames[frame].T_cam_ref) {
        target[i] = patchMean(map.frames[frame].frame->level(0),
                              shownPixel(map, camera, observation, shutters[frame]));
      }
    }
  });
  std::vector<std::vector<GreyPair>> pairs(map.frames.size());
  for (std::size_t i = 0; i < map.observations.size(); ++i) {
    const CornerObservation& observation = map.observations[i];
    const std::optional<double>& host = reference[observation.corner];
    if (host && target[i]) {
      pairs[observation.frame].push_back({*host, *target[i]});
    }
  }
  forEachRange(frames.size(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const std::size_t k = frames[i];
      map.frames[k].affine = affineOf(*map.frames.front().frame, *map.frames[k].frame, pairs[k]);
    }
  });
}

}  // namespace dsorb::init_orb
