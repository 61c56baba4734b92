// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/start/lens_profile.h"

#include "base/parallel.h"
#include "camera/lens_models.h"
#include "init/orb/bundle/reprojection_equations.h"
#include "init/orb/bundle/robust_adjustment.h"
#include "init/orb/start/start_gate.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

namespace dsorb::init_orb {
namespace {

constexpr std::array<LensScore, 4> kLenses = {
    {{0, 1 / 1.6, 0}, {0, 1.6, 0}, {0, 1, -0.15}, {0, 1, 0.15}}};
constexpr int kLensIterations = 10;     // of an adjustment
constexpr std::size_t kCorners = 160;   // that are enough: two a cell of the image
constexpr double kMinKeptShare = 0.95;  // of the corners; a lens that loses more says nothing

/// Some of the corners, evenly spread over their order.
InitialMap thinned(InitialMap map) {
  const std::size_t stride = std::max<std::size_t>(1, map.corners.size() / kCorners);
  std::vector<char> removed(map.corners.size());
  for (std::size_t i = 0; i < removed.size(); ++i) removed[i] = i % stride == 0 ? 0 : 1;
  removeCorners(map, removed);
  return map;
}

bool fixScale(InitialMap& map) {
  return map.scaleKnown() || normalizeCornerScale(map);
}

/// Sees corners and observations through a radial distortion.
void undistort(double radial, const PinholeCamera& camera, InitialMap& map) {
  const Lens lens{LensModel::kRadTan, camera.fx, camera.fy, camera.cx, camera.cy, {radial}};
  const double reach = monotoneRadius(lens);
  const auto undistorted = [&](Eigen::Vector2d& pixel) {
    Eigen::Vector2d ray = rayOfPixel(lens, pixel, reach);
    pixel = camera.project(ray.homogeneous());
    return ray;
  };
  for (Corner& corner : map.corners) undistorted(corner.pixel);
  for (CornerObservation& observation : map.observations) {
    const Eigen::Vector2d ray = undistorted(observation.pixel);
    observation.whitening *= (1 + radial * ray.squaredNorm()) * Eigen::Matrix2d::Identity() +
                             2 * radial * ray * ray.transpose();
  }
}

/// Where a camera of another focal length shows the same displacements.
void turnBy(double factor, InitialMap& map) {
  for (PosedFrame& frame : map.frames) {
    if (!frame.T_cam_ref) continue;
    Vector6d motion = frame.T_cam_ref->log();
    motion.tail<3>() *= factor;
    frame.T_cam_ref = SE3::exp(motion);
  }
}

/// Robust cost of an observation in the mean; nullopt when a point is behind a camera.
std::optional<double> meanCost(const InitialMap& map,
                               const PinholeCamera& camera,
                               const GeometricOptions& options) {
  const auto cost = reprojectionCost(map, camera, options);
  if (!cost || !(*cost > 0)) return std::nullopt;
  return *cost / static_cast<double>(map.observations.size());
}

Eigen::VectorXd increments(const InitialMap& from, const InitialMap& to) {
  Eigen::VectorXd moved(static_cast<Eigen::Index>(6 * from.joint_frames.size()));
  Eigen::Index row = 0;
  for (const std::size_t frame : from.joint_frames) {
    moved.segment<6>(row) =
        (*to.frames[frame].T_cam_ref * from.frames[frame].T_cam_ref->inverse()).log();
    row += 6;
  }
  return moved;
}

/// A lens with the map that was adjusted with it.
struct Adjusted {
  LensScore score;
  InitialMap map;
  double cost = 0;  ///< mean
};

/// Adjusts a map with another lens; nullopt where it does not allow that.
std::optional<Adjusted> adjustWith(const LensScore& lens,
                                   const InitialMap& map,
                                   const PinholeCamera& calibrated,
                                   const GeometricOptions& options) {
  InitialMap seen = map;
  PinholeCamera camera = calibrated;
  camera.fx *= lens.focal_factor;
  camera.fy *= lens.focal_factor;
  if (lens.radial != 0) undistort(lens.radial, camera, seen);
  turnBy(1 / lens.focal_factor, seen);
  auto other = adjustOnce(std::move(seen), camera, options, {kLensIterations});
  if (!other) return std::nullopt;
  if (static_cast<double>(other->corners.size()) <
      kMinKeptShare * static_cast<double>(map.corners.size())) {
    return std::nullopt;
  }
  const auto cost = meanCost(*other, camera, options);
  if (!cost || !fixScale(*other)) return std::nullopt;
  return Adjusted{lens, std::move(*other), *cost};
}

}  // namespace

std::optional<OtherLens> profileLens(const InitialMap& map,
                                     const PinholeCamera& camera,
                                     const GeometricOptions& options) {
  auto few = adjustOnce(thinned(map), camera, options, {kLensIterations});
  if (!few || !fixScale(*few)) return std::nullopt;
  const auto cost = meanCost(*few, camera, options);
  if (!cost) return std::nullopt;
  std::array<std::optional<Adjusted>, kLenses.size()> tried;
  forEachRange(kLenses.size(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      tried[i] = adjustWith(kLenses[i], *few, camera, options);
    }
  });
  const std::optional<Adjusted>* best = nullptr;
  for (const std::optional<Adjusted>& lens : tried) {
    if (lens && (best == nullptr || lens->cost < (*best)->cost)) best = &lens;
  }
  if (best == nullptr) return std::nullopt;
  // The noise is not known, so that its likelihood is a power of the mean cost; the errors of a
  // cell of the image count as one.
  OtherLens other{(*best)->score, increments(*few, (*best)->map)};
  other.score.gain = 0.5 * occupiedCells(*few, camera) * std::log(*cost / (*best)->cost);
  return other;
}

}  // namespace dsorb::init_orb
