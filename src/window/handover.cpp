// SPDX-License-Identifier: BSD-3-Clause
#include "window/handover.h"

#include "window/pair_geometry.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

namespace dsorb::window {
namespace {

constexpr float kWeightScale = 1e-3F;    // @source DSO as published
constexpr float kWeightOffset = 1e-12F;  // @source DSO as published
constexpr int kThinningRounds = 20;      // of the search for the cell size

/// Relative uncertainty, by which seeds compete for a cell.
float uncertainty(const SeedPoint& point) {
  if (!(point.variance > 0)) return std::numeric_limits<float>::max();
  return point.variance / (point.inverse_depth * point.inverse_depth);
}

std::vector<std::size_t> bestOfCells(const std::vector<SeedPoint>& points,
                                     int width,
                                     int height,
                                     double cell) {
  const int columns = static_cast<int>(width / cell) + 1;
  const int rows = static_cast<int>(height / cell) + 1;
  constexpr std::size_t kNone = std::numeric_limits<std::size_t>::max();
  std::vector<std::size_t> best(static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows),
                                kNone);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const std::ptrdiff_t x =
        std::clamp(static_cast<int>(points[i].pixel.x() / cell), 0, columns - 1);
    const std::ptrdiff_t y = std::clamp(static_cast<int>(points[i].pixel.y() / cell), 0, rows - 1);
    std::size_t& holder = best[static_cast<std::size_t>(y * columns + x)];
    if (holder == kNone || uncertainty(points[i]) < uncertainty(points[holder])) holder = i;
  }
  best.erase(std::remove(best.begin(), best.end(), kNone), best.end());
  std::sort(best.begin(), best.end());
  return best;
}

}  // namespace

std::vector<std::size_t> thinOnGrid(const std::vector<SeedPoint>& points,
                                    int width,
                                    int height,
                                    int wanted) {
  const auto limit = static_cast<std::size_t>(std::max(wanted, 0));
  double fine = 1;  // [px] cell sides; the coarser one is known to give few enough points
  double coarse = std::max(width, height);
  std::vector<std::size_t> kept = bestOfCells(points, width, height, fine);
  if (kept.size() <= limit) return kept;
  std::vector<std::size_t> result;
  for (int i = 0; i < kThinningRounds; ++i) {
    const double middle = std::sqrt(fine * coarse);
    kept = bestOfCells(points, width, height, middle);
    if (kept.size() > limit) {
      fine = middle;
    } else {
      coarse = middle;
      result = kept;
    }
  }
  return result;
}

float seedInformation(const SeedPoint& point, const PriorOptions& options) {
  const auto limit = static_cast<float>(options.max_depth);
  if (!(point.variance > 0)) return 0;
  return std::min(static_cast<float>(options.depth_gain) / point.variance, limit);
}

int seedPoints(Window& window,
               std::size_t host,
               const std::vector<SeedPoint>& points,
               const WindowOptions& options) {
  Keyframe& keyframe = window.keyframes[host];
  int added = 0;
  for (const SeedPoint& seed : points) {
    WindowPoint* point = addPoint(
        window, keyframe, {seed.pixel, seed.inverse_depth, seedInformation(seed, options.prior)});
    if (point == nullptr) continue;
    ++added;
    const std::size_t newest = window.keyframes.size() - 1;
    for (std::size_t k = 0; k <= newest; ++k) {
      if (k == host) continue;
      point->addObservation(k);
      if (newest - k < point->recent.size()) {
        point->recent[newest - k] = {window.keyframes[k].id, ResidualState::kIn};
      }
    }
  }
  return added;
}

namespace {

std::optional<DepthSample> sampleOf(const WindowPoint& point,
                                    const Eigen::Matrix3f& KRKi,
                                    const Eigen::Vector3f& Kt) {
  const Eigen::Vector3f p = KRKi * point.pixel.homogeneous() + Kt * point.inverse_depth;
  const float inverse_depth = point.inverse_depth / p.z();
  if (!(p.z() > 0) || !(inverse_depth > 0) || !(point.information > 0)) return std::nullopt;
  const float variance = 1.0F / point.information;
  return DepthSample{
      p.hnormalized(), inverse_depth, std::sqrt(kWeightScale / (variance + kWeightOffset))};
}

}  // namespace

std::vector<DepthSample> depthSamples(const Window& window, const WindowOptions& options) {
  std::vector<DepthSample> samples;
  const std::size_t newest = window.keyframes.size() - 1;
  const PairTable pairs(window);
  const Eigen::Matrix3f K = window.camera().matrix().cast<float>();
  for (std::size_t host = 0; host < newest; ++host) {
    const PairGeometry& pair = pairs.at(host, newest);
    const bool current = options.current_reference;
    const Eigen::Matrix3f KRKi =
        current ? pair.KRKi : Eigen::Matrix3f(K * pair.R_first * K.inverse());
    const Eigen::Vector3f Kt = current ? pair.Kt : Eigen::Vector3f(K * pair.t_first);
    for (const WindowPoint& point : window.keyframes[host].points) {
      const bool seen = std::any_of(point.begin(), point.end(), [&](const Observation& o) {
        return o.target == newest && o.state == ResidualState::kIn;
      });
      const auto sample = seen ? sampleOf(point, KRKi, Kt) : std::nullopt;
      if (sample) samples.push_back(*sample);
    }
  }
  return samples;
}

}  // namespace dsorb::window
