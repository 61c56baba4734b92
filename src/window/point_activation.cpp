// SPDX-License-Identifier: BSD-3-Clause
#include "window/point_activation.h"

#include "base/parallel.h"
#include "depth/candidate_activation.h"
#include "window/pair_geometry.h"

#include <cmath>
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

}  // namespace

void refineCandidates(Window& window,
                      const TrackedFrame& tracked,
                      const DepthOptions& options,
                      std::size_t grain) {
  placeCandidates(window);
  for (Keyframe& keyframe : window.keyframes) {
    if (keyframe.candidates.empty()) continue;
    const SE3 T_frame_host = tracked.T_cam_world * keyframe.T_cam_world().inverse();
    const BrightnessTransfer transfer = brightnessTransfer(
        keyframe.affine(), keyframe.frame->exposure(), tracked.affine, tracked.frame->exposure());
    depth::EpipolarPair pair(window.camera(), T_frame_host, transfer);
    pair.shutter = shutterOf(*tracked.frame, tracked.motion, window.change());
    depth::searchEpipolarLines(keyframe.candidates, pair, tracked.frame->level(0), options, grain);
  }
}

void activateCandidates(Window& window,
                        const WindowOptions& window_options,
                        const DepthOptions& options,
                        std::size_t grain) {
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
  forEachRange(chosen.size(), grain, [&](std::size_t begin, std::size_t end) {
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
            const DepthOptions& options,
            std::size_t grain) {
  addCandidates(window.keyframes.front(), pixels);
  for (const TrackedFrame& frame : frames) refineCandidates(window, frame, options, grain);
  activateCandidates(window, window_options, options, grain);
}

}  // namespace dsorb::window
