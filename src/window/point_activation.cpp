// SPDX-License-Identifier: BSD-3-Clause
#include "window/point_activation.h"

#include "base/parallel.h"
#include "depth/candidate_activation.h"
#include "estimate/epipolar_geometry.h"
#include "image/cell_grid.h"
#include "window/pair_geometry.h"

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

namespace dsorb::window {
namespace {

using depth::CandidatePoint;
using depth::CandidateVerdict;
using depth::DepthFit;

constexpr int kMapLevel = 1;        // pyramid level of the distance map
constexpr double kMaxDistance = 4;  // between points at most [px of half resolution]; DSO
constexpr double kMaxScale = 4;     // of the pixel selector, widens the distance

/// Candidate of a keyframe with the decision about it.
struct Pending {
  std::size_t keyframe = 0;
  std::size_t candidate = 0;
  DepthFit fit;
};

/// Host pixels of level 0 to pixels of the distance map in the newest keyframe.
EpipolarGeometry toMap(const Window& window, const Keyframe& host) {
  const PinholeCamera camera = window.camera();
  return {camera,
          camera.atLevel(kMapLevel),
          window.keyframes.back().T_cam_world() * host.T_cam_world().inverse()};
}

/// A projection into the map.
struct MapCell {
  Eigen::Vector2i cell{0, 0};
  float dither = 0;  // in [0, 1), differs between points
};

std::optional<MapCell> cellOf(const EpipolarGeometry& geometry,
                              const Eigen::Vector2f& pixel,
                              float inverse_depth,
                              const depth::DistanceMap& map) {
  const Eigen::Vector3f p = geometry.at(pixel, inverse_depth);
  if (!(p.z() > 0)) return std::nullopt;
  const float u = p.x() / p.z() + 0.5F;
  const float v = p.y() / p.z() + 0.5F;
  const bool inside = u >= 1 && v >= 1 && u < static_cast<float>(map.width()) &&
                      v < static_cast<float>(map.height());
  if (!inside) return std::nullopt;
  return MapCell{{static_cast<int>(u), static_cast<int>(v)}, p.x() - std::floor(p.x())};
}

void fillMap(const Window& window, depth::DistanceMap& map) {
  std::vector<Eigen::Vector2i> seeds;
  for (std::size_t k = 0; k + 1 < window.keyframes.size(); ++k) {
    const EpipolarGeometry geometry = toMap(window, window.keyframes[k]);
    for (const WindowPoint& point : window.keyframes[k].points) {
      const auto cell = cellOf(geometry, point.patch.pixel, point.inverse_depth, map);
      if (cell) seeds.push_back(cell->cell);
    }
  }
  map.add(seeds);
}

/// Sorts the candidates of one keyframe: dropped ones are marked, those with room are pending.
void choose(const Window& window,
            std::size_t position,
            depth::DistanceMap& map,
            std::vector<std::pair<CandidateVerdict, Pending>>& chosen) {
  const Keyframe& host = window.keyframes[position];
  const EpipolarGeometry geometry = toMap(window, host);
  for (std::size_t c = 0; c < host.candidates.size(); ++c) {
    const CandidatePoint& candidate = host.candidates[c];
    CandidateVerdict verdict = depth::judgeCandidate(candidate, host.leaves);
    if (verdict == CandidateVerdict::kReady) {
      const auto cell = cellOf(geometry, candidate.patch.pixel, candidate.middle(), map);
      const double room =
          cell ? map.at(cell->cell.x(), cell->cell.y()) + static_cast<double>(cell->dither) : 0;
      const double needed =
          window.activation_distance * static_cast<double>(candidate.selection_scale);
      if (!cell) {
        verdict = CandidateVerdict::kDrop;
      } else if (room < needed) {
        verdict = CandidateVerdict::kWait;
      } else {
        map.add({cell->cell});
      }
    }
    chosen.push_back({verdict, {position, c, {}}});
  }
}

/// Warps into all keyframes but the host, in the window's order.
std::vector<TargetImage> targetsOf(const PairTable& pairs, std::size_t host) {
  std::vector<TargetImage> targets;
  for (std::size_t k = 0; k < pairs.size(); ++k) {
    if (k != host) targets.push_back(pairs.at(host, k).current);
  }
  return targets;
}

void addActivated(Window& window, const Pending& pending) {
  Keyframe& host = window.keyframes[pending.keyframe];
  const CandidatePoint& candidate = host.candidates[pending.candidate];
  WindowPoint point;
  point.id = {window.next_point++};
  point.inverse_depth = pending.fit.inverse_depth;
  point.prior_inverse_depth = pending.fit.inverse_depth;
  point.information = pending.fit.information;
  point.patch = candidate.patch;
  std::size_t view = 0;
  addObservations(
      window, pending.keyframe, [&](std::size_t) { return bool{pending.fit.seen[view++]}; }, point);
  host.points.push_back(point);
}

constexpr float kWeightScale = 1e-3F;  // @source DSO as published
constexpr double kDepthCell = 0.0286;  // whose points tell of each other's depth, of width + height
constexpr float kDepthSpread = 1.3F;   // by which a depth may be beyond those of the points around
constexpr float kWeightOffset = 1e-12F;  // @source DSO as published

std::optional<DepthSample> sampleOf(const WindowPoint& point, const EpipolarGeometry& geometry) {
  const Eigen::Vector3f p = geometry.at(point.patch.pixel, point.inverse_depth);
  const float inverse_depth = point.inverse_depth / p.z();
  if (!(p.z() > 0) || !(inverse_depth > 0) || !(point.information > 0)) return std::nullopt;
  const float variance = 1.0F / point.information;
  return DepthSample{
      p.hnormalized(), inverse_depth, std::sqrt(kWeightScale / (variance + kWeightOffset))};
}

/// Pixels of a pinhole camera at the time of the middle row to those that the image shows.
void moveToRows(const Window& window, std::vector<DepthSample>& samples) {
  const std::optional<RollingShutter> shutter = window.shutter(window.keyframes.back());
  if (!shutter) return;
  const PinholeCamera camera = window.camera();
  for (DepthSample& sample : samples) {
    sample.pixel = pixelInRow(*shutter, camera, sample.pixel, sample.inverse_depth);
  }
}

/// Least and greatest inverse depth of several points.
struct DepthRange {
  float min = std::numeric_limits<float>::infinity();
  float max = 0;

  void add(const DepthRange& other) {
    min = std::min(min, other.min);
    max = std::max(max, other.max);
  }
};

/// Range of a cell and those around it.
DepthRange rangeAround(const CellGrid& grid,
                       const std::vector<DepthRange>& ranges,
                       const Eigen::Vector2f& pixel) {
  const int column = grid.column(static_cast<double>(pixel.x()));
  const int row = grid.row(static_cast<double>(pixel.y()));
  DepthRange around;
  for (int y = std::max(0, row - 1); y <= std::min(grid.rows() - 1, row + 1); ++y) {
    for (int x = std::max(0, column - 1); x <= std::min(grid.columns() - 1, column + 1); ++x) {
      around.add(ranges[grid.index(x, y)]);
    }
  }
  return around;
}

}  // namespace

void refineCandidates(Window& window, const TrackedFrame& tracked, const DepthOptions& options) {
  placeCandidates(window);
  for (Keyframe& keyframe : window.keyframes) {
    if (keyframe.candidates.empty()) continue;
    const SE3 T_frame_host = tracked.T_cam_world * keyframe.T_cam_world().inverse();
    const BrightnessTransfer transfer = brightnessTransfer(
        keyframe.affine(), keyframe.frame->exposure(), tracked.affine, tracked.frame->exposure());
    depth::EpipolarPair pair(window.camera(), T_frame_host, transfer);
    pair.shutter = shutterOf(*tracked.frame, tracked.motion, window.change());
    depth::searchEpipolarLines(keyframe.candidates, pair, tracked.frame->level(0), options);
  }
}

void activateCandidates(Window& window,
                        const WindowOptions& window_options,
                        const DepthOptions& options) {
  if (window.keyframes.size() < 2) return;
  placePoints(window);
  placeCandidates(window);
  window.activation_distance = depth::adaptDistance(window.activation_distance,
                                                    static_cast<int>(window.numPoints()),
                                                    window_options.desired_points,
                                                    kMaxDistance);
  const PinholeCamera map_camera = window.first_camera.atLevel(kMapLevel);
  const auto reach = static_cast<int>(std::ceil(kMaxScale * window.activation_distance));
  depth::DistanceMap map(map_camera.width, map_camera.height, reach);
  fillMap(window, map);
  std::vector<std::pair<CandidateVerdict, Pending>> chosen;
  const PairTable pairs(window);
  std::vector<std::vector<TargetImage>> targets;
  for (std::size_t k = 0; k + 1 < window.keyframes.size(); ++k) {
    targets.push_back(targetsOf(pairs, k));
    choose(window, k, map, chosen);
  }
  forEachRange(chosen.size(), kTaskGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      auto& [verdict, pending] = chosen[i];
      if (verdict != CandidateVerdict::kReady) continue;
      pending.fit =
          depth::fitDepth(window.keyframes[pending.keyframe].candidates[pending.candidate],
                          pairs.rays(),
                          targets[pending.keyframe],
                          options);
      verdict = pending.fit.verdict;
    }
  });
  std::vector<std::vector<CandidatePoint>> waiting(window.keyframes.size());
  for (const auto& [verdict, pending] : chosen) {
    if (verdict == CandidateVerdict::kReady) {
      addActivated(window, pending);
    } else if (verdict != CandidateVerdict::kDrop) {
      waiting[pending.keyframe].push_back(
          window.keyframes[pending.keyframe].candidates[pending.candidate]);
    }
  }
  for (std::size_t k = 0; k + 1 < window.keyframes.size(); ++k) {
    window.keyframes[k].candidates = std::move(waiting[k]);
  }
}

void fillUp(Window& window,
            const std::vector<SelectedPixel>& pixels,
            const std::vector<TrackedFrame>& frames,
            const WindowOptions& window_options,
            const DepthOptions& options) {
  addCandidates(window.keyframes.front(), pixels);
  for (const TrackedFrame& frame : frames) refineCandidates(window, frame, options);
  activateCandidates(window, window_options, options);
}

void expectDepths(Keyframe& keyframe, const std::vector<DepthSample>& samples) {
  const Frame& frame = *keyframe.frame;
  const CellGrid grid(frame.width(), frame.height(), kDepthCell * (frame.width() + frame.height()));
  std::vector<DepthRange> ranges(grid.size());
  DepthRange all;
  for (const DepthSample& sample : samples) {
    const DepthRange one{sample.inverse_depth, sample.inverse_depth};
    const std::size_t cell =
        grid.at(static_cast<double>(sample.pixel.x()), static_cast<double>(sample.pixel.y()));
    ranges[cell].add(one);
    all.add(one);
  }
  if (!(all.max > 0)) return;
  for (depth::CandidatePoint& candidate : keyframe.candidates) {
    DepthRange range = rangeAround(grid, ranges, candidate.patch.pixel);
    if (!(range.max > 0)) range = all;
    candidate.expected_min = range.min / kDepthSpread;
    candidate.expected_max = range.max * kDepthSpread;
  }
}

std::vector<DepthSample> depthSamples(const Window& window, const WindowOptions& options) {
  std::vector<DepthSample> samples;
  const std::size_t newest = window.keyframes.size() - 1;
  const auto pose = [&](const Keyframe& keyframe) {
    return options.published ? keyframe.T_cam_world_first : keyframe.T_cam_world();
  };
  for (std::size_t host = 0; host < newest; ++host) {
    const Keyframe& keyframe = window.keyframes[host];
    const EpipolarGeometry geometry(window.camera(),
                                    pose(window.keyframes[newest]) * pose(keyframe).inverse());
    for (const WindowPoint& point : keyframe.points) {
      const bool seen = std::any_of(point.begin(), point.end(), [&](const Observation& o) {
        return o.target == newest && o.state == ResidualState::kIn;
      });
      const auto sample = seen ? sampleOf(point, geometry) : std::nullopt;
      if (sample) samples.push_back(*sample);
    }
  }
  moveToRows(window, samples);
  return samples;
}

}  // namespace dsorb::window
