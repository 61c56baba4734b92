// SPDX-License-Identifier: BSD-3-Clause
#include "odometry/seed_window.h"

#include "base/spread_frames.h"
#include "geometry/recent_motion.h"
#include "window/point_activation.h"
#include "window/seeding.h"

#include <algorithm>
#include <vector>

namespace dsorb::odometry {
namespace {

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

/// Motion of a frame while its rows are read, from its posed neighbours.
RowMotion motionOf(const InitializationResult& result, std::size_t frame) {
  const auto posed_at = [&](std::size_t i) {
    return TimedPose{result.frames[i].frame->timestamp(), *result.frames[i].T_cam_ref};
  };
  std::vector<TimedPose> neighbours;
  for (const std::size_t i : {frame - 1, frame + 1, frame - 2, frame + 2}) {  // wraps below 0
    if (i < result.frames.size() && result.frames[i].T_cam_ref) neighbours.push_back(posed_at(i));
  }
  return motionThrough(posed_at(frame), neighbours);
}

/// Standard deviation of the velocities of motionOf().
Vector6d motionSigma(const InitializationResult& result) {
  RecentMotion motion;
  for (const PosedFrame& posed : result.frames) {
    if (posed.T_cam_ref) motion.push({{posed.frame->timestamp(), *posed.T_cam_ref}});
  }
  return motion.sigma();
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
  for (const std::size_t i : window::thinOnGrid(points, frame.width(), frame.height(), wanted)) {
    kept.push_back(points[i]);
  }
  window::seedPoints(window, position, kept, options);
}

/// Fills a sparse window up with pixels of the reference, searched in all posed frames behind it.
void fillUp(window::Window& window,
            const InitializationResult& result,
            const OdometryOptions& options,
            PixelSelector& selector,
            std::size_t grain) {
  window::Keyframe& reference = window.keyframes.front();
  selectCandidates(reference,
                   selector,
                   StuckRegions(result.stuck, reference.frame->width(), reference.frame->height()),
                   options.depth.candidates_per_keyframe);
  for (std::size_t i = 1; i < result.frames.size(); ++i) {
    const PosedFrame& posed = result.frames[i];
    if (!posed.T_cam_ref) continue;
    window::refineCandidates(window,
                             {posed.frame, *posed.T_cam_ref, posed.affine, motionOf(result, i)},
                             options.depth,
                             grain);
  }
  window::activateCandidates(window, options.window, options.depth, grain);
}

}  // namespace

void selectCandidates(window::Keyframe& keyframe,
                      PixelSelector& selector,
                      const StuckRegions& stuck,
                      int wanted) {
  std::vector<SelectedPixel> selected = selector.select(*keyframe.frame, wanted);
  stuck.removeFrom(selected);
  window::addCandidates(keyframe, selected);
}

window::Window seedWindow(const InitializationResult& result,
                          const PinholeCamera& camera,
                          const OdometryOptions& options,
                          PixelSelector& selector,
                          std::size_t grain) {
  window::Window window(camera, options.brightness);
  const std::vector<std::size_t> keyframes = keyframesOf(result, options.window);
  std::vector<std::vector<MapPoint>> points;
  std::size_t total = 0;
  const Vector6d sigma = motionSigma(result);
  for (const std::size_t i : keyframes) {
    const PosedFrame& posed = result.frames[i];
    const RowMotion motion = motionOf(result, i);
    window::addKeyframe(window, posed.frame, *posed.T_cam_ref, posed.affine, options.window)
        .setMotion(motion, {motion, sigma});
    points.push_back(pointsOf(result, i));
    total += points.back().size();
  }
  if (result.readout) {
    const double change = result.readout->seconds - window.calibratedReadout().seconds;
    window.camera_state[window::kReadout] = change / window::kReadoutScale;
    window.readout_sigma = result.readout->sigma;
  }
  for (std::size_t k = 0; k < points.size(); ++k) {
    if (!points[k].empty()) addPoints(window, k, points[k], total, options.window);
  }
  if (!options.initializer.skip.has(Mechanism::kFillUp) &&
      static_cast<double>(total) < kNearlyFull * options.window.desired_points) {
    fillUp(window, result, options, selector, grain);
  }
  return window;
}

}  // namespace dsorb::odometry
