// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/first_window.h"

#include "dsorb/image/frame_priors.h"

#include "base/erase_marked.h"
#include "base/median.h"
#include "base/parallel.h"
#include "image/cell_grid.h"
#include "image/image_scale.h"
#include "image/photometric.h"
#include "image/pixel_selector.h"
#include "image/stuck_regions.h"
#include "init/orb/map/initial_map.h"
#include "window/point_activation.h"
#include "window/window_optimizer.h"

#include <Eigen/LU>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <unordered_map>
#include <utility>
#include <vector>

namespace dsorb::init_orb {
namespace {

constexpr std::size_t kNeighbours = 7;
constexpr std::size_t kMinNeighbours = 3;
constexpr float kCellSize = 1.0F / 3;  // of the radius
constexpr float kQuantile = 0.35F;     // of the differences

PointGrid gridOf(const std::vector<Eigen::Vector2f>& pixels, float cell_size) {
  Eigen::Vector2f farthest(0, 0);
  for (const Eigen::Vector2f& pixel : pixels) farthest = farthest.cwiseMax(pixel);
  return {
      pixels,
      CellGrid(static_cast<int>(farthest.x()) + 1, static_cast<int>(farthest.y()) + 1, cell_size)};
}

constexpr int kCandidates = 3000;  // pixels of the reference that are searched
/// Variance of a grey value that makes information of covariances [grey levels^2].
constexpr double kGreyVariance = 50;
constexpr double kMinDisagreement = 0.1;    // of log inverse depth, to the neighbours
constexpr double kMaxDisagreement = 4;      // over the median of all points, beyond that
constexpr float kMaxRelativeSigma = 0.03F;  // of a point that the images have told

constexpr double kMaxDeviations = 3;  // between a point and a known depth [sigma]

/// Position of a corner in the map, by the identity of its point in the window.
using CornerOf = std::unordered_map<int, std::size_t>;

WindowOptions windowOptions() {
  WindowOptions options;
  options.prior.depth_gain = kGreyVariance;
  return options;
}

void addFrame(window::Window& window,
              const InitialMap& map,
              std::size_t frame,
              const WindowOptions& options) {
  const PosedFrame& posed = map.frames[frame];
  window::Keyframe& keyframe =
      window::addKeyframe(window, posed.frame, *posed.T_cam_ref, posed.affine, options);
  if (map.motions.empty()) return;
  const FrameMotion& motion = map.motions[frame];
  keyframe.setMotion(motion.found, motion.prior);
}

/// Information that the corners give the poses of the adjusted frames, as the window's prior.
void holdPoses(window::Window& window, const InitialMap& map) {
  const Eigen::MatrixXd information = map.joint_covariance.inverse();
  if (!information.allFinite()) return;
  const Vector6d scale = window::frameScale().head<6>();
  const auto frames = static_cast<Eigen::Index>(map.joint_frames.size());
  for (Eigen::Index i = 0; i < frames; ++i) {
    const Eigen::Index row = window.rowOf(static_cast<std::size_t>(i) + 1);
    for (Eigen::Index k = 0; k < frames; ++k) {
      const Eigen::Index column = window.rowOf(static_cast<std::size_t>(k) + 1);
      window.prior.H.block<6, 6>(row, column) += kGreyVariance * scale.asDiagonal() *
                                                 information.block<6, 6>(6 * i, 6 * k) *
                                                 scale.asDiagonal();
    }
  }
}

/// The reference and the adjusted frames, hosted by it the corners.
window::Window seedWindow(const InitialMap& map,
                          const PinholeCamera& camera,
                          const WindowOptions& options,
                          CornerOf& corner_of) {
  window::Window window(camera);
  addFrame(window, map, 0, options);
  for (const std::size_t frame : map.joint_frames) addFrame(window, map, frame, options);
  window::setReadout(window, map.readout);
  for (std::size_t i = 0; i < map.corners.size(); ++i) {
    const Corner& corner = map.corners[i];
    window::WindowPoint* point =
        window::addPoint(window,
                         window.keyframes.front(),
                         corner.seen(),
                         static_cast<float>(corner.inverse_depth),
                         static_cast<float>(options.prior.depth_gain / corner.variance));
    if (point == nullptr) continue;
    window::addObservations(
        window, 0, [](std::size_t) { return true; }, *point);
    corner_of[point->id.value] = i;
  }
  holdPoses(window, map);
  return window;
}

/// Searches pixels of the reference in all other keyframes.
void fillUp(window::Window& window, const InitialMap& map, std::uint64_t seed) {
  window::Keyframe& reference = window.keyframes.front();
  const Frame& frame = *reference.frame;
  PixelSelectorOptions options;
  options.seed = static_cast<int>(seed);
  PixelSelector selector(frame.width(), frame.height(), options);
  std::vector<SelectedPixel> selected = selector.select(frame, kCandidates);
  StuckRegions(map.stuck, frame.width(), frame.height()).removeFrom(selected);
  std::vector<window::TrackedFrame> others;
  for (std::size_t k = 1; k < window.keyframes.size(); ++k) {
    const window::Keyframe& keyframe = window.keyframes[k];
    others.push_back({keyframe.frame, keyframe.T_cam_world(), keyframe.affine(), keyframe.motion});
  }
  window::fillUp(window, selected, others, windowOptions(), DepthOptions());
  reference.candidates.clear();
}

/// Drops points that disagree with their neighbours, and those of which the images say little.
void keepConsistent(window::Window& window, const CornerOf& corner_of) {
  std::vector<window::WindowPoint>& points = window.keyframes.front().points;
  const Frame& frame = *window.keyframes.front().frame;
  std::vector<Eigen::Vector2f> pixels;
  std::vector<double> inverse_depths;
  for (const window::WindowPoint& point : points) {
    pixels.push_back(point.patch.pixel);
    inverse_depths.push_back(static_cast<double>(point.inverse_depth));
  }
  const double radius = kNeighbourRadius * imageScale(frame.width(), frame.height());
  const std::vector<double> disagreement =
      neighbourDisagreement(pixels, inverse_depths, static_cast<float>(radius));
  const double limit = std::max(kMinDisagreement, kMaxDisagreement * medianOf(disagreement));
  std::vector<char> dropped(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    const window::WindowPoint& point = points[i];
    const bool is_corner = corner_of.count(point.id.value) != 0;
    const float sigma = static_cast<float>(kImageNoise) / std::sqrt(point.information);
    const bool unsure = !is_corner && !(sigma < kMaxRelativeSigma * point.inverse_depth);
    dropped[i] = unsure || !(disagreement[i] <= limit) ? 1 : 0;
  }
  eraseMarked(dropped, points);
}

/// Takes the points that agree with more than half of the frames into the map; corners that do not
/// are removed.
void takePoints(const window::Window& window, const CornerOf& corner_of, InitialMap& map) {
  const auto frames = static_cast<int>(map.joint_frames.size());
  std::vector<char> removed(map.corners.size(), 1);
  map.points.clear();
  for (const window::WindowPoint& point : window.keyframes.front().points) {
    const int observations = point.num_observations;
    if (!(point.variance > 0) || !(point.inverse_depth > 0) || 2 * observations <= frames) continue;
    const auto corner = corner_of.find(point.id.value);
    if (corner != corner_of.end()) {
      removed[corner->second] = 0;
    } else {
      map.points.push_back(
          {0, point.patch.seen, point.inverse_depth, point.variance, observations});
    }
  }
  removeCorners(map, removed);
}

/// Fuses the points with depths that the caller knows, where the start is made of them and both
/// agree; corners have theirs in the adjustment.
/// @source Engel, Sturm, Cremers, ICCV 2013, section 2.3 (product of Gaussians)
void fuseKnownDepths(InitialMap& map, double inflation) {
  const DepthLookup lookup(*map.frames.front().frame->priors()->depth, map.metres, inflation);
  for (InitPoint& point : map.points) {
    const KnownInverseDepth known = lookup.at(point.pixel);
    const auto own = static_cast<double>(point.variance);
    const double difference = known.mean - static_cast<double>(point.inverse_depth);
    const double sum = own + known.variance;
    if (!known || difference * difference > kMaxDeviations * kMaxDeviations * sum) continue;
    point.inverse_depth += static_cast<float>(own / sum * difference);
    point.variance = static_cast<float>(own * known.variance / sum);
  }
}

}  // namespace

std::vector<double> neighbourDisagreement(const std::vector<Eigen::Vector2f>& pixels,
                                          const std::vector<double>& inverse_depths,
                                          float radius) {
  const PointGrid grid = gridOf(pixels, kCellSize * radius);
  std::vector<double> logs(inverse_depths.size());
  std::transform(inverse_depths.begin(), inverse_depths.end(), logs.begin(), [](double rho) {
    return rho > 0 ? std::log(rho) : -std::numeric_limits<double>::infinity();
  });
  std::vector<double> disagreement(pixels.size(), 0.0);
  forEachRange(pixels.size(), kTaskGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const auto neighbours = grid.nearest<kNeighbours>(pixels[i], radius, [&](std::size_t other) {
        return other != i && inverse_depths[other] > 0;
      });
      if (neighbours.count < kMinNeighbours) continue;
      std::array<double, kNeighbours> differences;
      differences.fill(std::numeric_limits<double>::infinity());
      std::transform(
          neighbours.begin(), neighbours.end(), differences.begin(), [&](const auto& neighbour) {
            return std::abs(logs[neighbour.point] - logs[i]);
          });
      std::sort(differences.begin(), differences.end());
      disagreement[i] =
          differences[static_cast<std::size_t>(kQuantile * static_cast<float>(neighbours.count))];
    }
  });
  return disagreement;
}

Outcome<Reconstruction> fillFirstWindow(Reconstruction start, const AttemptContext& context) {
  InitialMap& map = start.map;
  const WindowOptions options = windowOptions();
  estimateBrightness(map, context.camera);
  CornerOf corner_of;
  window::Window window = context.clock.time(
      "seed", [&] { return seedWindow(map, context.camera, options, corner_of); });
  context.clock.time("fill", [&] {
    fillUp(window, map, context.seed());
    keepConsistent(window, corner_of);
  });
  const auto report = context.clock.time(
      "variances", [&] { return window::WindowOptimizer(options).assess(window); });
  if (!report.finite || report.residuals == 0) return InitReason::kPoorQuality;
  takePoints(window, corner_of, map);
  if (map.scaleKnown() && start.depth_prior) fuseKnownDepths(map, start.depth_prior->inflation);
  return start;
}

}  // namespace dsorb::init_orb
