// SPDX-License-Identifier: BSD-3-Clause
#include "odometry/seed_window.h"

#include "base/spread_frames.h"
#include "estimate/host_patch.h"
#include "estimate/warp.h"
#include "geometry/recent_motion.h"
#include "image/cell_grid.h"
#include "window/point_activation.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <map>
#include <numeric>
#include <utility>
#include <vector>

namespace dsorb::odometry {
namespace {

constexpr int kThinningRounds = 20;  // of the search for the cell size

/// Relative uncertainty, by which seeds compete for a cell.
float uncertainty(const MapPoint& point) {
  if (!(point.variance > 0)) return std::numeric_limits<float>::max();
  return point.variance / (point.inverse_depth * point.inverse_depth);
}

constexpr double kNearlyFull = 0.9;  // of the wanted points; beyond it no search is worth its time

/// Indices of the frames that become keyframes, ascending: the reference, the newest, as many hosts
/// as the window holds, those with most points first, and evenly spread frames up to the wanted
/// number: the more frames see the first points, the better their depths.
std::vector<std::size_t> keyframesOf(const InitializationResult& result,
                                     const WindowOptions& options) {
  const std::size_t newest = result.frames.size() - 1;
  std::vector<int> hosted(result.frames.size(), 0);
  for (const InitPoint& point : result.points) ++hosted[static_cast<std::size_t>(point.host)];
  std::vector<std::size_t> hosts;
  for (std::size_t i = 1; i < newest; ++i) {
    if (hosted[i] > 0) hosts.push_back(i);
  }
  std::stable_sort(hosts.begin(), hosts.end(), [&](std::size_t l, std::size_t r) {
    return hosted[l] > hosted[r];
  });
  hosts.resize(std::min(hosts.size(), static_cast<std::size_t>(options.max_keyframes - 2)));
  std::vector<std::size_t> keyframes = {0, newest};
  keyframes.insert(keyframes.end(), hosts.begin(), hosts.end());
  const auto wanted =
      static_cast<std::size_t>(std::min(options.first_keyframes, options.max_keyframes));
  for (const std::size_t i : spreadFrames(result.frames.size(), wanted)) {
    if (keyframes.size() >= wanted) break;
    const bool is_new = std::find(keyframes.begin(), keyframes.end(), i) == keyframes.end();
    if (result.frames[i].T_cam_ref && is_new) keyframes.push_back(i);
  }
  std::sort(keyframes.begin(), keyframes.end());
  return keyframes;
}

std::vector<MapPoint> pointsOf(const InitializationResult& result, std::size_t host) {
  std::vector<MapPoint> points;
  for (const InitPoint& point : result.points) {
    if (static_cast<std::size_t>(point.host) != host) continue;
    points.push_back({point.pixel, point.inverse_depth, point.variance});
  }
  return points;
}

/// Motions of the frames while their rows are read, from their posed neighbours.
struct FrameMotions {
  std::vector<RowMotion> of_frame;
  Vector6d sigma;  // standard deviation of the velocities
};

FrameMotions motionsOf(const InitializationResult& result) {
  std::vector<TimedPose> poses;
  RecentMotion recent;
  for (const PosedFrame& posed : result.frames) {
    if (!posed.T_cam_ref) continue;
    poses.push_back({posed.frame->timestamp(), *posed.T_cam_ref});
    recent.push({poses.back()});
  }
  const std::vector<RowMotion> along = motionsAlong(poses);
  FrameMotions motions{{}, recent.sigma()};
  auto next = along.begin();
  for (const PosedFrame& posed : result.frames) {
    motions.of_frame.push_back(posed.T_cam_ref ? *next++ : RowMotion());
  }
  return motions;
}

/// Thins the points of one host to its share of the wanted number.
void addPoints(window::Window& window,
               std::size_t position,
               const std::vector<MapPoint>& points,
               std::size_t total,
               const WindowOptions& options) {
  const Frame& frame = *window.keyframes[position].frame;
  const double share = static_cast<double>(points.size()) / static_cast<double>(total);
  const int wanted = static_cast<int>(share * options.desired_points);
  std::vector<MapPoint> kept;
  for (const std::size_t i : thinOnGrid(points, frame.width(), frame.height(), wanted)) {
    kept.push_back(points[i]);
  }
  seedPoints(window, position, kept, options);
}

std::vector<SelectedPixel> selected(const window::Keyframe& keyframe,
                                    PixelSelector& selector,
                                    const StuckRegions& stuck,
                                    int wanted) {
  std::vector<SelectedPixel> pixels = selector.select(*keyframe.frame, wanted);
  stuck.removeFrom(pixels);
  return pixels;
}

/// The posed frames behind the reference.
std::vector<window::TrackedFrame> othersOf(const InitializationResult& result,
                                           const FrameMotions& motions) {
  std::vector<window::TrackedFrame> others;
  for (std::size_t i = 1; i < result.frames.size(); ++i) {
    const PosedFrame& posed = result.frames[i];
    if (!posed.T_cam_ref) continue;
    others.push_back({posed.frame, *posed.T_cam_ref, posed.affine, motions.of_frame[i]});
  }
  return others;
}

using Pixel = std::pair<float, float>;

/// A point of the adjusted window.
struct Adjusted {
  double inverse_depth = 0;
  double information = 0;  ///< of the inverse depth, times the variance of a grey value
};

/// All points that are still in use, by their ids.
std::map<int, Adjusted> adjustedPoints(const window::Window& window) {
  std::map<int, Adjusted> points;
  const auto add = [&](const window::WindowPoint& point) {
    if (!(point.inverse_depth > 0) || !(point.information > 0)) return;
    points[point.id.value] = {static_cast<double>(point.inverse_depth),
                              static_cast<double>(point.information)};
  };
  for (const window::Keyframe& keyframe : window.keyframes) {
    for (const window::WindowPoint& point : keyframe.points) add(point);
    for (const window::WindowPoint& point : keyframe.marginalized) add(point);
  }
  return points;
}

/// Whether the newest keyframe sees a point of another one. A window drops what it does not see.
bool newestSees(const window::Window& window,
                const window::Keyframe& host,
                const window::WindowPoint& point) {
  const window::Keyframe& newest = window.keyframes.back();
  const PinholeCamera camera = window.camera();
  const auto projection = projectHosted(camera,
                                        newest.T_cam_world() * host.T_cam_world().inverse(),
                                        camera.unproject(point.patch.pixel.cast<double>()),
                                        static_cast<double>(point.inverse_depth));
  return projection && canSample(newest.frame->level(0),
                                 static_cast<float>(projection->pixel.x()),
                                 static_cast<float>(projection->pixel.y()),
                                 kPatternRadius);
}

}  // namespace

std::vector<std::size_t> thinOnGrid(const std::vector<MapPoint>& points,
                                    int width,
                                    int height,
                                    int wanted) {
  const auto limit = static_cast<std::size_t>(std::max(wanted, 0));
  std::vector<std::size_t> all(points.size());
  std::iota(all.begin(), all.end(), std::size_t{0});
  const auto best_of_cells = [&](double cell) {
    return bestOfCells(
        CellGrid(width, height, cell),
        all,
        [&](std::size_t i) { return points[i].pixel; },
        [&](std::size_t a, std::size_t b) {
          return uncertainty(points[a]) < uncertainty(points[b]);
        });
  };
  double fine = 1;  // [px] cell sides; the coarser one is known to give few enough points
  double coarse = std::max(width, height);
  std::vector<std::size_t> kept = best_of_cells(fine);
  if (kept.size() <= limit) return kept;
  std::vector<std::size_t> result;
  for (int i = 0; i < kThinningRounds; ++i) {
    const double middle = std::sqrt(fine * coarse);
    kept = best_of_cells(middle);
    if (kept.size() > limit) {
      fine = middle;
    } else {
      coarse = middle;
      result = kept;
    }
  }
  return result;
}

float seedInformation(const MapPoint& point, const PriorOptions& options) {
  const auto limit = static_cast<float>(options.max_depth);
  if (!(point.variance > 0)) return 0;
  return std::min(static_cast<float>(options.depth_gain) / point.variance, limit);
}

int seedPoints(window::Window& window,
               std::size_t host,
               const std::vector<MapPoint>& points,
               const WindowOptions& options) {
  window::Keyframe& keyframe = window.keyframes[host];
  int added = 0;
  for (const MapPoint& seed : points) {
    window::WindowPoint* point = window::addPoint(
        window, keyframe, seed.pixel, seed.inverse_depth, seedInformation(seed, options.prior));
    if (point == nullptr) continue;
    ++added;
    window::addObservations(
        window, host, [](std::size_t) { return true; }, *point);
  }
  return added;
}

void selectCandidates(window::Keyframe& keyframe,
                      PixelSelector& selector,
                      const StuckRegions& stuck,
                      int wanted) {
  window::addCandidates(keyframe, selected(keyframe, selector, stuck, wanted));
}

window::Window seedWindow(const InitializationResult& result,
                          const PinholeCamera& camera,
                          const OdometryOptions& options,
                          PixelSelector& selector) {
  window::Window window(camera, options.brightness);
  const std::vector<std::size_t> keyframes = keyframesOf(result, options.window);
  std::vector<std::vector<MapPoint>> points;
  std::size_t total = 0;
  const FrameMotions motions = motionsOf(result);
  for (const std::size_t i : keyframes) {
    const PosedFrame& posed = result.frames[i];
    const RowMotion& motion = motions.of_frame[i];
    window::addKeyframe(window, posed.frame, *posed.T_cam_ref, posed.affine, options.window)
        .setMotion(motion, {motion, motions.sigma});
    points.push_back(pointsOf(result, i));
    total += points.back().size();
  }
  window::setReadout(window, result.readout);
  for (std::size_t k = 0; k < points.size(); ++k) {
    if (!points[k].empty()) addPoints(window, k, points[k], total, options.window);
  }
  if (!options.initializer.skip.has(Mechanism::kFillUp) &&
      static_cast<double>(total) < kNearlyFull * options.window.desired_points) {
    const window::Keyframe& reference = window.keyframes.front();
    const StuckRegions stuck(result.stuck, reference.frame->width(), reference.frame->height());
    const int wanted = options.depth.candidates_per_keyframe;
    window::fillUp(window,
                   selected(reference, selector, stuck, wanted),
                   othersOf(result, motions),
                   options.window,
                   options.depth);
  }
  return window;
}

StartComparison::StartComparison(const InitializationResult& result, const window::Window& seeded) {
  for (const window::Keyframe& keyframe : seeded.keyframes) {
    T_cam_world_.push_back(keyframe.T_cam_world());
    std::map<Pixel, const InitPoint*> hosted;
    for (const InitPoint& point : result.points) {
      if (result.frames[static_cast<std::size_t>(point.host)].frame != keyframe.frame) continue;
      hosted[{point.pixel.x(), point.pixel.y()}] = &point;
    }
    for (const window::WindowPoint& point : keyframe.points) {
      const auto initial = hosted.find({point.patch.seen.x(), point.patch.seen.y()});
      if (initial == hosted.end()) continue;  // the window's own
      const auto inverse_depth = static_cast<double>(initial->second->inverse_depth);
      const auto variance = static_cast<double>(initial->second->variance);
      if (!(inverse_depth > 0)) continue;
      points_.push_back({point.id, inverse_depth, variance, newestSees(seeded, keyframe, point)});
    }
  }
}

StartChange StartComparison::change(const window::Window& adjusted, double noise) const {
  const SE3 T_ref_world = T_cam_world_.front().inverse();
  const SE3 T_ref_world_after = adjusted.keyframes.front().T_cam_world().inverse();
  std::vector<StartPose> poses;
  for (std::size_t k = 1; k < T_cam_world_.size(); ++k) {
    poses.push_back(
        {T_cam_world_[k] * T_ref_world, adjusted.keyframes[k].T_cam_world() * T_ref_world_after});
  }
  const std::map<int, Adjusted> after = adjustedPoints(adjusted);
  const double limited = std::min(noise, kMaxStartNoise);
  std::vector<StartPoint> points;
  for (const Point& point : points_) {
    const auto found = after.find(point.id.value);
    if (found == after.end() && !point.stays) continue;
    StartPoint& change = points.emplace_back();
    change.inverse_depth = point.inverse_depth;
    change.variance = point.variance;
    if (found == after.end()) continue;
    change.adjusted = found->second.inverse_depth;
    change.adjusted_variance = limited * limited / found->second.information;
  }
  return startChange(poses, points);
}

}  // namespace dsorb::odometry
