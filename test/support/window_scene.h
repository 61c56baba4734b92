// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/window.h"

#include "base/random.h"
#include "odometry/seed_window.h"
#include "synthetic/sequence.h"
#include "window/window.h"

#include <algorithm>
#include <cmath>
#include <vector>

namespace dsorb {

/// Keyframes of a rendered room with its truth; unit: mean inverse depth of the points is 1.
struct WindowScene {
  explicit WindowScene(const window::Window& w) : window(w) {}
  window::Window window;
  std::vector<SE3> true_poses;             ///< T_cam_world, by keyframe
  std::vector<std::vector<float>> depths;  ///< true inverse depths, by keyframe and point
};

struct WindowSceneOptions {
  std::vector<int> frames = {0, 4, 8, 12};
  int width = 320;
  int height = 240;
  int cell = 12;  ///< one point in a square of this side [px]
  int hosts = 0;  ///< number of keyframes that host points; 0: all but the newest
  double exposure_changes = 0;
  float prior_variance = 0;  ///< of the true inverse depths; 0: unknown
  BrightnessModel brightness = BrightnessModel::kUncalibrated;
};

namespace window_scene {

/// Pixel of strongest gradient of a cell, away from depth edges; x < 0: none.
inline Eigen::Vector2i bestOfCell(
    const PyramidLevel& level, const std::vector<float>& depth, int x0, int y0, int cell) {
  constexpr float kMinSquaredGradient = 64;  // [grey^2/px^2]
  constexpr float kMaxDepthStep = 0.03F;     // relative, to the pixels 3 px away
  Eigen::Vector2i best(-1, -1);
  float strongest = kMinSquaredGradient;
  const int width = level.width();
  const auto at = [&](int x, int y) { return depth[static_cast<std::size_t>(y * width + x)]; };
  for (int y = std::max(y0, 5); y < std::min(y0 + cell, level.height() - 5); ++y) {
    for (int x = std::max(x0, 5); x < std::min(x0 + cell, width - 5); ++x) {
      const ImageSample sample = level.at(x, y);
      const float gradient = sample.dx * sample.dx + sample.dy * sample.dy;
      const float here = at(x, y);
      bool smooth = here > 0 && std::isfinite(sample.intensity);
      for (int step : {-3, 3}) {
        smooth = smooth && std::abs(at(x + step, y) - here) < kMaxDepthStep * here &&
                 std::abs(at(x, y + step) - here) < kMaxDepthStep * here;
      }
      if (!smooth || !(gradient > strongest)) continue;
      strongest = gradient;
      best = {x, y};
    }
  }
  return best;
}

inline std::vector<MapPoint> truePoints(const PyramidLevel& level,
                                        const std::vector<float>& depth,
                                        int cell,
                                        float variance) {
  std::vector<MapPoint> points;
  for (int y = 0; y < level.height(); y += cell) {
    for (int x = 0; x < level.width(); x += cell) {
      const Eigen::Vector2i best = bestOfCell(level, depth, x, y, cell);
      if (best.x() < 0) continue;
      points.push_back({best.cast<float>(),
                        depth[static_cast<std::size_t>(best.y() * level.width() + best.x())],
                        variance});
    }
  }
  return points;
}

}  // namespace window_scene

/// The truth as a window: every point has a residual to every other keyframe.
inline WindowScene makeWindowScene(const WindowSceneOptions& scene_options,
                                   const WindowOptions& options) {
  synthetic::SequenceOptions sequence_options;
  sequence_options.kind = synthetic::SequenceKind::kRoom;
  sequence_options.width = scene_options.width;
  sequence_options.height = scene_options.height;
  sequence_options.exposure_changes = scene_options.exposure_changes;
  sequence_options.rendering.supersampling = 2;
  const synthetic::SyntheticSequence sequence(sequence_options);
  std::vector<FramePtr> frames;
  std::vector<std::vector<MapPoint>> points;
  double sum = 0;
  std::size_t count = 0;
  for (std::size_t k = 0; k < scene_options.frames.size(); ++k) {
    const int index = scene_options.frames[k];
    const synthetic::SyntheticFrame rendered = sequence.frame(index);
    frames.push_back(sequence.framePtr(rendered, index));
    points.push_back(window_scene::truePoints(frames.back()->level(0),
                                              rendered.inverse_depth,
                                              scene_options.cell,
                                              scene_options.prior_variance));
    for (const MapPoint& point : points.back()) {
      sum += static_cast<double>(point.inverse_depth);
      ++count;
    }
  }
  const double scale = sum / static_cast<double>(count);
  WindowScene scene(window::Window(sequence.camera(), scene_options.brightness));
  const SE3 T_world_first = sequence.pose(scene_options.frames[0]);
  for (std::size_t k = 0; k < frames.size(); ++k) {
    SE3 T = sequence.pose(scene_options.frames[k]).inverse() * T_world_first;
    T.setTranslation(T.translation() * scale);
    scene.true_poses.push_back(T);
    window::addKeyframe(scene.window, frames[k], T, {}, options);
  }
  const std::size_t hosts =
      scene_options.hosts > 0 ? static_cast<std::size_t>(scene_options.hosts) : frames.size() - 1;
  for (std::size_t k = 0; k < hosts; ++k) {
    for (MapPoint& point : points[k]) point.inverse_depth /= static_cast<float>(scale);
    odometry::seedPoints(scene.window, k, points[k], options);
  }
  for (const window::Keyframe& keyframe : scene.window.keyframes) {
    scene.depths.emplace_back();
    for (const window::WindowPoint& point : keyframe.points) {
      scene.depths.back().push_back(point.inverse_depth);
    }
  }
  return scene;
}

/// Random errors on all poses but the first, on brightness and on inverse depths.
/// @param size  of rotations [rad] and translations [unit]; inverse depths get 5 times as much,
///              relative
inline void perturb(WindowScene& scene, double size, std::uint64_t seed) {
  Random random(seed);
  for (std::size_t k = 0; k < scene.window.keyframes.size(); ++k) {
    window::Keyframe& keyframe = scene.window.keyframes[k];
    if (k > 0) {
      Vector6d xi;
      for (int i = 0; i < 6; ++i) xi[i] = size * random.gaussian();
      keyframe.T_cam_world_first = SE3::exp(xi) * keyframe.T_cam_world_first;
      keyframe.state[6] = size * random.gaussian();
      keyframe.state[7] = size * random.gaussian();
      keyframe.first = keyframe.state;
    }
    for (window::WindowPoint& point : keyframe.points) {
      point.inverse_depth *= static_cast<float>(1 + 5 * size * random.gaussian());
    }
  }
}

}  // namespace dsorb
