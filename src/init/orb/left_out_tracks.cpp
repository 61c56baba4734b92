// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/left_out_tracks.h"

#include "base/erase_marked.h"
#include "base/median.h"
#include "base/parallel.h"
#include "estimate/warp.h"
#include "geometry/triangulate.h"
#include "image/cell_grid.h"
#include "image/contrast.h"
#include "image/image_scale.h"
#include "two_view/essential_motion.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <vector>

namespace dsorb::init_orb {
namespace {

constexpr int kEdgeRadius = 7;       // of the square whose gradients are looked at [px]
constexpr float kMaxEdgeRatio = 10;  // of the eigenvalues of a corner's gradient tensor
// Share of the tracks; with fewer corners the others go. Bars have 0 to 20 %: drawn at an angle
// they show steps of pixels, which raise the smaller eigenvalue. TartanAir's bare corridors have
// 26 % at least, other recordings 37.
constexpr double kMinCornerShare = 0.25;

/// Whether the gradients around a place have one direction only: a misfit of a fraction of a pixel
/// across the edge then moves a track by several times as much along it.
/// @param noise variance that noise gives a gradient [grey levels^2 / px^2]
bool isOnEdge(const PyramidLevel& image, const Eigen::Vector2f& place, float noise) {
  const int x0 = static_cast<int>(std::lround(place.x()));
  const int y0 = static_cast<int>(std::lround(place.y()));
  float xx = 0;
  float xy = 0;
  float yy = 0;
  float pixels = 0;
  for (int y = std::max(0, y0 - kEdgeRadius); y <= std::min(image.height() - 1, y0 + kEdgeRadius);
       ++y) {
    for (int x = std::max(0, x0 - kEdgeRadius); x <= std::min(image.width() - 1, x0 + kEdgeRadius);
         ++x) {
      const ImageSample sample = image.at(x, y);
      ++pixels;
      xx += sample.dx * sample.dx;
      xy += sample.dx * sample.dy;
      yy += sample.dy * sample.dy;
    }
  }
  const float middle = (xx + yy) / 2;
  const float half = std::sqrt((xx - yy) * (xx - yy) / 4 + xy * xy);
  const float of_noise = pixels * noise;
  return middle + half - of_noise > kMaxEdgeRatio * std::max(0.0F, middle - half - of_noise);
}

constexpr float kStill = 0.5F;           // largest distance from the place in the reference [px]
constexpr double kMinMoved = 3;          // median of the others in the newest frame [px]
constexpr double kMinOffEpipolar = 0.5;  // median from the epipolar lines of the others [px]
constexpr double kMinShare = 0.03;       // of the tracks; a few are outliers like others
constexpr double kMaxCellShare = 0.45;   // of the image's cells with tracks; more: the scene stands
constexpr int kColumns = 8;
constexpr int kRows = 6;

/// Whether each track stands still in all frames.
std::vector<char> stillTracks(const CornerTracks& tracks) {
  std::vector<char> still(static_cast<std::size_t>(tracks.size()), 1);
  for (const std::vector<Eigen::Vector2f>& positions : tracks.positions) {
    for (std::size_t i = 0; i < still.size(); ++i) {
      const float moved = (positions[i] - tracks.positions.front()[i]).norm();
      if (moved > kStill) still[i] = 0;  // unseen is not moved
    }
  }
  return still;
}

/// Share of the cells with tracks in which most of these stand still.
double stillCells(const Matches& matches,
                  const std::vector<char>& still,
                  const PinholeCamera& camera) {
  const CellGrid grid(camera.width, camera.height, kColumns, kRows);
  std::vector<int> balance(grid.size(), 0);
  std::vector<char> taken(grid.size(), 0);
  for (std::size_t i = 0; i < still.size(); ++i) {
    const std::size_t cell = grid.at(matches.reference[i].x(), matches.reference[i].y());
    balance[cell] += still[i] != 0 ? 1 : -1;
    taken[cell] = 1;
  }
  const auto standing = std::count_if(balance.begin(), balance.end(), [](int b) { return b > 0; });
  return static_cast<double>(standing) /
         static_cast<double>(std::count(taken.begin(), taken.end(), 1));
}

// Matches of another motion over those of a start, so that either may be the world's. Wrong tracks
// of 7-Scenes agree about .23, or .25 with a spread of .27; a street beside a van that is taken for
// it has .29 and .43.
constexpr double kMinRivalShare = 0.25;      // their number
constexpr double kMinRivalSpread = 1.0 / 3;  // their spreadOf()

/// Mean squared distance from the mean [px^2]: an area.
double spreadOf(const std::vector<Eigen::Vector2d>& places) {
  Eigen::Vector2d sum = Eigen::Vector2d::Zero();
  double squared = 0;
  for (const Eigen::Vector2d& place : places) {
    sum += place;
    squared += place.squaredNorm();
  }
  const double count = std::max(1.0, static_cast<double>(places.size()));
  return squared / count - (sum / count).squaredNorm();
}

constexpr double kMinError = 1;       // rms over the frames from which a track may contradict [px]
constexpr double kErrorFactor = 5;    // and by which it exceeds the median of all tracks [-]
constexpr std::size_t kVoters = 5;    // nearest tracks that vote on a point
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

void leaveOutEdges(const PyramidLevel& image, CornerTracks& tracks) {
  const auto& shown = tracks.seen.empty() ? tracks.positions.front() : tracks.seen;
  std::vector<char> on_edge;
  on_edge.reserve(shown.size());
  const double noise = noiseOf(image);
  const auto of_gradient = static_cast<float>(noise * noise / 2);  // of a central difference
  for (const Eigen::Vector2f& place : shown) {
    on_edge.push_back(isOnEdge(image, place, of_gradient) ? 1 : 0);
  }
  const auto corners = static_cast<double>(std::count(on_edge.begin(), on_edge.end(), char{0}));
  if (corners < kMinCornerShare * static_cast<double>(shown.size())) tracks.drop(on_edge);
}

std::vector<Eigen::Vector2f> leaveOutStuck(CornerTracks& tracks,
                                           const PinholeCamera& camera,
                                           std::uint64_t seed) {
  const std::vector<char> still = stillTracks(tracks);
  const auto count = static_cast<int>(std::count(still.begin(), still.end(), 1));
  if (count < kMinShare * tracks.size() || tracks.size() - count < kMinCornersOfMotion) return {};
  const Matches all = tracks.matchesTo(tracks.frames() - 1);
  Matches standing;
  Matches others;
  std::vector<double> moved;
  for (std::size_t i = 0; i < still.size(); ++i) {
    Matches& part = still[i] != 0 ? standing : others;
    part.reference.push_back(all.reference[i]);
    part.target.push_back(all.target[i]);
    if (still[i] == 0) moved.push_back((all.target[i] - all.reference[i]).norm());
  }
  if (medianInPlace(moved) < kMinMoved || stillCells(all, still, camera) > kMaxCellShare) return {};
  const auto motion = estimateEssentialMotion(others, camera, seed);
  if (!motion) return {};
  const double distance = medianOf(epipolarDistances(motion->T_cur_ref, standing, camera));
  if (distance < kMinOffEpipolar) return {};
  std::vector<Eigen::Vector2f> stuck;
  stuck.reserve(standing.size());
  for (const Eigen::Vector2d& pixel : standing.reference) {
    stuck.emplace_back(pixel.cast<float>());
  }
  tracks.drop(still);
  return stuck;
}

bool hasRival(const SE3& T_cur_ref,
              const Matches& matches,
              const PinholeCamera& camera,
              std::uint64_t seed) {
  const SE3 unit(T_cur_ref.unitQuaternion(), T_cur_ref.translation().normalized());
  const std::vector<double> distances = epipolarDistances(unit, matches, camera);
  std::vector<Eigen::Vector2d> explained;
  Matches left_out;
  for (std::size_t i = 0; i < matches.size(); ++i) {
    if (distances[i] < kRansacThreshold) {
      explained.push_back(matches.reference[i]);
      continue;
    }
    left_out.reference.push_back(matches.reference[i]);
    left_out.target.push_back(matches.target[i]);
  }
  const double least = kMinRivalShare * static_cast<double>(explained.size());
  if (static_cast<double>(left_out.size()) < least) return false;
  const auto rival = estimateEssentialMotion(left_out, camera, seed);
  if (!rival || rival->inliers < least) return false;
  std::vector<Eigen::Vector2d> others;
  for (std::size_t i = 0; i < left_out.size(); ++i) {
    if (rival->inlier[i] != 0) others.push_back(left_out.reference[i]);
  }
  return others.size() > explained.size() ||
         spreadOf(others) > kMinRivalSpread * spreadOf(explained);
}

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
    : radius_(static_cast<float>(kNeighbourRadius * imageScale(camera.width, camera.height))),
      grid_(tracks.positions.front(), CellGrid(camera.width, camera.height, radius_)) {
  const std::vector<double> errors = trackErrors(map, tracks, camera);
  const double limit = std::max(kMinError, kErrorFactor * medianOf(errors));
  for (const double error : errors) contradicts_.push_back(error > limit ? 1 : 0);
}

std::vector<char> DynamicRegions::covered(const std::vector<Eigen::Vector2f>& pixels) const {
  std::vector<char> covered(pixels.size(), 0);
  forEachRange(pixels.size(), kTaskGrain, [&](std::size_t begin, std::size_t end) {
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

void DynamicRegions::removeFrom(InitialMap& map) const {
  std::vector<Eigen::Vector2f> pixels;
  pixels.reserve(map.corners.size());
  for (const Corner& corner : map.corners) pixels.emplace_back(corner.pixel.cast<float>());
  removeCorners(map, covered(pixels));
  pixels.clear();
  for (const InitPoint& point : map.points) pixels.push_back(point.pixel);
  eraseMarked(covered(pixels), map.points);
}

}  // namespace dsorb::init_orb
