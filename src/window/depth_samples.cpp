// SPDX-License-Identifier: BSD-3-Clause
#include "window/depth_samples.h"

#include "estimate/epipolar_geometry.h"
#include "image/cell_grid.h"

#include <Eigen/Core>
#include <Eigen/Geometry>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <optional>

namespace dsorb::window {
namespace {

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
