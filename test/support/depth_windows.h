// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/io/sequence_reader.h"
#include "dsorb/options/initializer.h"

#include "image/photometric.h"
#include "init/orb/orb_initializer.h"
#include "init/orb/reference_pool.h"
#include "support/init_run.h"
#include "support/real_data.h"
#include "synthetic/sequence.h"

#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

namespace dsorb {

/// A few frames from a reference on, with the truth of the reference's depths and of the poses.
struct DepthWindow {
  PinholeCamera camera;
  std::vector<FramePtr> frames;
  std::vector<SE3> T_cam_ref;             ///< true
  std::vector<float> true_inverse_depth;  ///< of the reference, row-major; 0: unknown [1/m]

  /// Whether some pixel of the patch around a point has its inverse depth within a share: on the
  /// outline of an object the patch shows two depths, and either is right.
  /// @param inverse_depth [1/m]
  [[nodiscard]] bool agrees(const Eigen::Vector2d& pixel,
                            double inverse_depth,
                            double share) const {
    for (int dy = -kPatternRadius; dy <= kPatternRadius; ++dy) {
      for (int dx = -kPatternRadius; dx <= kPatternRadius; ++dx) {
        const double truth = truthAt(pixel + Eigen::Vector2d(dx, dy));
        if (truth > 0 && std::abs(truth / inverse_depth - 1) <= share) return true;
      }
    }
    return false;
  }
  /// True inverse depth at the nearest pixel [1/m].
  [[nodiscard]] double truthAt(const Eigen::Vector2d& pixel) const {
    const auto x = static_cast<int>(std::lround(pixel.x()));
    const auto y = static_cast<int>(std::lround(pixel.y()));
    return static_cast<double>(true_inverse_depth[static_cast<std::size_t>(y * camera.width + x)]);
  }
};

/// How good the depths of a map are after the best single scale.
struct DepthQuality {
  int points = 0;
  int off = 0;               ///< more than 20 % off in depth at their pixel
  int outliers = 0;          ///< so far off everywhere in their patch
  double median = 0;         ///< relative error
  double within_10 = 0;      ///< share
  double nees = 0;           ///< median of error^2 / variance
  double direction_deg = 0;  ///< error of the newest frame's translation direction
  double rotation_deg = 0;

  [[nodiscard]] int good() const { return points - outliers; }
};

inline DepthQuality judge(const init_orb::InitialMap& map, const DepthWindow& window) {
  struct Point {
    Eigen::Vector2d pixel;
    double inverse_depth, ratio, relative_variance;
  };
  std::vector<Point> points;
  std::vector<double> ratios;
  const auto add = [&](const Eigen::Vector2d& pixel, double rho, double variance) {
    const double truth = window.truthAt(pixel);
    if (!(truth > 0)) return;
    points.push_back({pixel, rho, rho / truth, variance / (truth * truth)});
    ratios.push_back(rho / truth);
  };
  for (const auto& corner : map.corners) add(corner.pixel, corner.inverse_depth, corner.variance);
  for (const auto& point : map.points) {
    add(point.pixel.cast<double>(),
        static_cast<double>(point.inverse_depth),
        static_cast<double>(point.variance));
  }
  const double scale = medianOrNan(ratios);
  DepthQuality quality;
  quality.points = static_cast<int>(points.size());
  std::vector<double> errors;
  std::vector<double> normalized;
  for (const Point& point : points) {
    const double error = point.ratio / scale - 1;
    errors.push_back(std::abs(error));
    normalized.push_back(error * error / (point.relative_variance / (scale * scale)));
    const double depth_error = std::abs(scale / point.ratio - 1);
    quality.off += !(depth_error <= 0.2) ? 1 : 0;
    quality.outliers += window.agrees(point.pixel, point.inverse_depth / scale, 0.2) ? 0 : 1;
    quality.within_10 += depth_error <= 0.1 ? 1.0 / static_cast<double>(points.size()) : 0;
  }
  quality.median = medianOrNan(errors);
  quality.nees = medianOrNan(normalized);
  const SE3& pose = *map.frames.back().T_cam_ref;
  const SE3& truth = window.T_cam_ref[map.frames.size() - 1];
  quality.direction_deg = directionErrorDeg(pose.translation(), truth.translation());
  quality.rotation_deg = rotationErrorDeg(pose, truth);
  return quality;
}

/// Frames of a rendered sequence from `first` on.
inline DepthWindow renderedWindow(const synthetic::SyntheticSequence& sequence,
                                  int first,
                                  int frames) {
  DepthWindow window{sequence.camera(), {}, {}, sequence.inverseDepth(first)};
  for (int k = 0; k < frames; ++k) {
    window.frames.push_back(sequence.framePtr(first + k));
    window.T_cam_ref.push_back(sequence.pose(first + k).inverse() * sequence.pose(first));
  }
  return window;
}

/// Poses of a file with lines "timestamp tx ty tz qx qy qz qw", camera to world.
inline std::vector<SE3> readTruth(const std::filesystem::path& file) {
  std::ifstream in(file);
  std::vector<SE3> poses;
  for (std::string line; std::getline(in, line);) {
    if (line.empty() || line[0] == '#') continue;
    std::istringstream text(line);
    double time = 0;
    Eigen::Vector3d t;
    Eigen::Vector4d q;
    text >> time >> t.x() >> t.y() >> t.z() >> q.x() >> q.y() >> q.z() >> q.w();
    poses.emplace_back(Eigen::Quaterniond(q), t);
  }
  return poses;
}

/// Frames of a sequence with depth images (16-bit millimetres, 0: none) in the data folder.
inline DepthWindow realWindow(const std::string& sequence, int first, int frames) {
  const std::filesystem::path folder = realData(sequence);
  SequenceOptions options;
  options.path = folder.string();
  options.start = first;
  options.end = first + frames;
  SequenceReader reader(options);
  const std::vector<SE3> poses = readTruth(folder / "groundtruth.txt");
  DepthWindow window;
  window.camera = reader.camera();
  std::string image_file;
  while (auto next = reader.next()) {
    if (window.frames.empty()) image_file = next->image_file;
    window.frames.push_back(next->frame);
    const auto index = static_cast<std::size_t>(next->index);
    window.T_cam_ref.push_back(poses.at(index).inverse() *
                               poses.at(static_cast<std::size_t>(first)));
  }
  const std::filesystem::path name = std::filesystem::path(image_file).stem().string() + ".png";
  const cv::Mat depth = cv::imread((folder / "depth" / name).string(), cv::IMREAD_UNCHANGED);
  for (int y = 0; y < depth.rows; ++y) {
    for (int x = 0; x < depth.cols; ++x) {
      const auto millimetres = static_cast<float>(depth.at<std::uint16_t>(y, x));
      window.true_inverse_depth.push_back(millimetres > 0 ? 1000 / millimetres : 0);
    }
  }
  return window;
}

/// The map that a start makes of a window, at the first frame where it does.
inline std::optional<init_orb::InitialMap> mapOf(const DepthWindow& window,
                                                 const InitializerOptions& options) {
  init_orb::ReferencePool pool(options.orb, options.max_waiting_mb);
  pool.start(window.frames.front());
  for (std::size_t k = 1; k < window.frames.size(); ++k) {
    pool.advance(window.frames[k]);
    if (static_cast<int>(k) + 1 < options.orb.min_frames) continue;
    StageClock clock;
    auto attempt = init_orb::attemptFrom(pool.view(0), {window.camera, options, clock});
    if (attempt.made) return std::move(attempt.made->map);
  }
  return std::nullopt;
}

}  // namespace dsorb
