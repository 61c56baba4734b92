// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/dynamic_regions.h"

#include "base/median.h"
#include "base/parallel.h"
#include "estimate/warp.h"
#include "geometry/triangulate.h"
#include "image/image_scale.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>

namespace dsorb::init_orb {
namespace {

constexpr std::size_t kPixelGrain = 64;  // pixels one thread judges at a time

constexpr double kMinError = 1;     // rms over the frames from which a track may contradict [px]
constexpr double kErrorFactor = 5;  // and by which it exceeds the median of all tracks [-]
constexpr std::size_t kVoters = 5;  // nearest tracks that vote on a point
// Tracks farther away do not vote, for an image diagonal of 800 px [px].
constexpr double kVoteRadius = 60;
constexpr double kMaxShare = 0.4;     // of contradicting neighbours that a point may have
constexpr int kIterations = 3;        // of Gauss-Newton on one inverse depth
constexpr std::size_t kMinVotes = 3;  // fewer tracks close by decide nothing
constexpr double kLost = 1e6;         // [px]; error of a track behind a camera

struct PosedObservation {
  SE3 T_cam_ref;
  Eigen::Vector2d pixel;
};

/// Error of a point seen from several cameras, and the step that reduces it.
struct DepthStep {
  double squared = 0;  // [px^2]
  double step = 0;     // [1/unit]
};

std::optional<DepthStep> evaluate(const std::vector<PosedObservation>& observations,
                                  const PinholeCamera& camera,
                                  const Eigen::Vector3d& ray,
                                  double inverse_depth) {
  DepthStep fit;
  double information = 0;
  double gradient = 0;
  for (const PosedObservation& observation : observations) {
    const auto projection = projectHosted(camera, observation.T_cam_ref, ray, inverse_depth);
    if (!projection) return std::nullopt;
    const Eigen::Vector2d residual = observation.pixel - projection->pixel;
    fit.squared += residual.squaredNorm();
    information += projection->J_inverse_depth.squaredNorm();
    gradient += projection->J_inverse_depth.dot(residual);
  }
  fit.step = information > 0 ? gradient / information : 0;
  return fit;
}

double trackError(const std::vector<PosedObservation>& observations,
                  const PinholeCamera& camera,
                  const Eigen::Vector3d& ray) {
  if (observations.empty()) return 0;
  const PosedObservation& widest = observations.back();
  const auto start = triangulateInverseDepth(
      widest.T_cam_ref, ray, camera.unproject(widest.pixel).head<2>(), 1 / camera.fx);
  double inverse_depth = start ? std::max(start->inverse_depth, 0.0) : 0.0;
  double best = kLost * kLost;
  for (int i = 0; i <= kIterations; ++i) {
    const auto fit = evaluate(observations, camera, ray, inverse_depth);
    if (!fit) break;
    best = std::min(best, fit->squared);
    inverse_depth = std::max(inverse_depth + fit->step, 0.0);
  }
  return std::sqrt(best / static_cast<double>(observations.size()));
}

}  // namespace

std::vector<double> trackErrors(const InitialMap& map,
                                const CornerTracks& tracks,
                                const PinholeCamera& camera) {
  std::vector<double> errors(static_cast<std::size_t>(tracks.size()));
  std::vector<PosedObservation> observations;
  for (std::size_t i = 0; i < errors.size(); ++i) {
    observations.clear();
    for (std::size_t k = 1; k < tracks.positions.size(); ++k) {
      const Eigen::Vector2f& pixel = tracks.positions[k][i];
      if (map.frames[k].T_cam_ref && std::isfinite(pixel.x())) {
        observations.push_back({*map.frames[k].T_cam_ref, pixel.cast<double>()});
      }
    }
    errors[i] = trackError(
        observations, camera, camera.unproject(tracks.positions.front()[i].cast<double>()));
  }
  return errors;
}

DynamicRegions::DynamicRegions(const InitialMap& map,
                               const CornerTracks& tracks,
                               const PinholeCamera& camera)
    : radius_(static_cast<float>(kVoteRadius * imageScale(camera.width, camera.height))),
      grid_(tracks.positions.front(), CellGrid(camera.width, camera.height, radius_)) {
  const std::vector<double> errors = trackErrors(map, tracks, camera);
  const double limit = std::max(kMinError, kErrorFactor * medianOf(errors));
  for (const double error : errors) contradicts_.push_back(error > limit ? 1 : 0);
  contradicting_ = static_cast<int>(std::count(contradicts_.begin(), contradicts_.end(), 1));
}

std::vector<char> DynamicRegions::covered(const std::vector<Eigen::Vector2f>& pixels) const {
  std::vector<char> covered(pixels.size(), 0);
  if (contradicting_ == 0) return covered;
  forEachRange(pixels.size(), kPixelGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const auto nearest = grid_.nearest<kVoters>(pixels[i], radius_);
      const auto against = std::count_if(nearest.begin(), nearest.end(), [&](const auto& track) {
        return contradicts_[track.point] != 0;
      });
      const bool enough = nearest.count >= kMinVotes;
      const bool most =
          static_cast<double>(against) > kMaxShare * static_cast<double>(nearest.count);
      covered[i] = enough && most ? 1 : 0;
    }
  });
  return covered;
}

int DynamicRegions::removeCorners(InitialMap& map) const {
  std::vector<Eigen::Vector2f> pixels;
  pixels.reserve(map.corners.size());
  for (const Corner& corner : map.corners) pixels.emplace_back(corner.pixel.cast<float>());
  return init_orb::removeCorners(map, covered(pixels));
}

int DynamicRegions::removePoints(InitialMap& map) const {
  const std::size_t before = map.points.size();
  std::vector<Eigen::Vector2f> pixels;
  pixels.reserve(map.points.size());
  for (const InitPoint& point : map.points) pixels.push_back(point.pixel);
  eraseMarked(covered(pixels), map.points);
  return static_cast<int>(before - map.points.size());
}

}  // namespace dsorb::init_orb
