// SPDX-License-Identifier: BSD-3-Clause
#include "place/recognition.h"

#include "base/median.h"
#include "features/pose_from_matches.h"
#include "image/cell_grid.h"
#include "place/binary_matches.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <set>
#include <utility>

namespace dsorb::place {
namespace {

constexpr std::size_t kReach = 3;       // keyframes before and after that belong to a place
constexpr std::size_t kMinMatches = 8;  // of a pose
constexpr std::uint64_t kSeed = 49;     // of samples; any number
constexpr double kRadius = 6;           // of the search around a prediction, the same width [px]
constexpr int kAlike = 60;              // distance of descriptors of one corner at most [bits]
constexpr double kCell = 16;            // of the lookup of features [px]
// Shares of links between 12 rooms that have the same walls and nothing else in common (.052 to
// .111), and of those that match one stretch of a wall with another (.103 to .124).
constexpr double kSharedWalls = 0.08;
constexpr double kSharedWallsSigma = 0.03;
// The same of one view with 60 and more found points, which its pose was chosen by: 56 views among
// 2,070 pairs of such rooms have .141 with a standard deviation of .016, and at most .196.
constexpr double kSharedByView = 0.14;
constexpr double kSharedByViewSigma = 0.02;
constexpr double kLeastWrong = 1e-9;  // no test was long enough for less
constexpr double kLogChance = -4;     // of a view that shows the place by itself

/// Feature of a view near a place that is most like a descriptor.
class Lookup {
 public:
  Lookup(const Query& query, std::vector<Eigen::Vector2d> pixels)
      : view_(*query.view),
        pixels_(std::move(pixels)),
        grid_(asFloats(pixels_), CellGrid(query.camera.width, query.camera.height, kCell)) {}
  /// @return -1 where there is none
  [[nodiscard]] int find(const Eigen::Vector2d& place,
                         double radius,
                         const BinaryDescriptor& descriptor) const {
    int best = -1;
    int least = kAlike + 1;
    const Eigen::Vector2f at = place.cast<float>();
    grid_.forEachWithin(at, static_cast<float>(radius), [&](std::size_t i) {
      const int bits = distance(view_.descriptors[i], descriptor);
      if (bits >= least) return;
      least = bits;
      best = static_cast<int>(i);
    });
    return best;
  }
  [[nodiscard]] const Eigen::Vector2d& pixel(std::size_t i) const { return pixels_[i]; }

 private:
  static std::vector<Eigen::Vector2f> asFloats(const std::vector<Eigen::Vector2d>& pixels) {
    std::vector<Eigen::Vector2f> floats;
    floats.reserve(pixels.size());
    for (const Eigen::Vector2d& pixel : pixels) floats.emplace_back(pixel.cast<float>());
    return floats;
  }

  const View& view_;
  std::vector<Eigen::Vector2d> pixels_;
  PointGrid grid_;
};

std::vector<Eigen::Vector2d> pinholePixels(const Query& query) {
  StoredKeyframe as_keyframe;
  as_keyframe.camera = query.camera;
  as_keyframe.radial = query.radial;
  as_keyframe.view.pixels = query.view->pixels;
  std::vector<Eigen::Vector2d> pixels;
  for (std::size_t i = 0; i < query.view->size(); ++i) pixels.push_back(as_keyframe.pixel(i));
  return pixels;
}

double pixelScale(const PinholeCamera& camera) {
  return camera.width / 640.0;
}

/// log10 of the probability that of n independent tries at least k succeed (Chernoff's bound).
double logTail(int k, int n, double p) {
  if (n == 0 || k <= p * n) return 0;
  const double q = static_cast<double>(k) / n;
  const double divergence =
      q * std::log(q / p) + (q < 1 ? (1 - q) * std::log((1 - q) / (1 - p)) : 0);
  return -n * divergence / std::log(10.0);
}

/// Points that were found where a pose predicts them.
struct Found {
  std::vector<std::pair<std::size_t, std::size_t>> pairs;  // point, feature
  Evidence evidence;
};

Found findPredicted(const KeyframeStore& store,
                    const std::vector<StoredPoint>& points,
                    const Query& query,
                    const Lookup& lookup,
                    const SE3& T_view_world) {
  const PinholeCamera& camera = query.camera;
  const double radius = kRadius * pixelScale(camera);
  const CellGrid cells = viewCells(camera);
  std::set<std::size_t> covered;
  std::vector<int> owner(query.view->size(), -1);
  Found found;
  int elsewhere = 0;
  int tries = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector3d p = T_view_world * points[i].position;
    if (!(p.z() > 0)) continue;
    const Eigen::Vector2d place = camera.project(p);
    if (!camera.contains(place, 16)) continue;
    ++found.evidence.predicted;
    const BinaryDescriptor& descriptor =
        store[points[i].keyframe].view.descriptors[points[i].feature];
    for (const double share : {0.25, 0.5, 0.75}) {  // what would be found anywhere
      const Eigen::Vector2d other(std::fmod(place.x() + share * camera.width, camera.width),
                                  std::fmod(place.y() + share * camera.height, camera.height));
      elsewhere += lookup.find(other, radius, descriptor) >= 0 ? 1 : 0;
      ++tries;
    }
    const int feature = lookup.find(place, radius, descriptor);
    if (feature < 0 || owner[static_cast<std::size_t>(feature)] >= 0) continue;
    owner[static_cast<std::size_t>(feature)] = static_cast<int>(i);
    covered.insert(cells.at(place.x(), place.y()));
    found.pairs.emplace_back(i, static_cast<std::size_t>(feature));
  }
  Evidence& evidence = found.evidence;
  evidence.found = static_cast<int>(found.pairs.size());
  evidence.cells = static_cast<int>(covered.size());
  evidence.chance = (elsewhere + 1.0) / (tries + 2.0);
  evidence.log_chance = logTail(evidence.found, evidence.predicted, evidence.chance);
  return found;
}

struct Matched {
  std::vector<std::size_t> points;
  std::vector<std::size_t> features;
};

Matched matchPoints(const KeyframeStore& store,
                    const std::vector<StoredPoint>& points,
                    const View& view) {
  std::vector<BinaryDescriptor> descriptors;
  descriptors.reserve(points.size());
  for (const StoredPoint& point : points) {
    descriptors.push_back(store[point.keyframe].view.descriptors[point.feature]);
  }
  const std::vector<int> partner = mutualMatches(view.descriptors, descriptors);
  Matched matched;
  for (std::size_t i = 0; i < partner.size(); ++i) {
    if (partner[i] < 0) continue;
    matched.features.push_back(i);
    matched.points.push_back(static_cast<std::size_t>(partner[i]));
  }
  return matched;
}

/// Pose that most matches agree with. @return T_view_world
std::optional<SE3> poseOfMost(const std::vector<StoredPoint>& points,
                              const Matched& matched,
                              const Lookup& lookup,
                              const PinholeCamera& camera,
                              const SE3& T_world_host) {
  const SE3 T_host_world = T_world_host.inverse();
  std::vector<PointObservation> matches;
  for (std::size_t i = 0; i < matched.points.size(); ++i) {
    const Eigen::Vector3d p = T_host_world * points[matched.points[i]].position;
    if (p.z() > 0) matches.push_back({p / p.z(), 1 / p.z(), lookup.pixel(matched.features[i])});
  }
  const std::optional<MatchedPose> pose = poseFromMatches(matches, camera, kSeed);
  if (!pose) return std::nullopt;
  return pose->T_cam_host * T_host_world;
}

Sight sightOf(const KeyframeStore& store,
              const StoredPoint& point,
              const SE3& T_cam_map,
              const PinholeCamera& camera,
              const Eigen::Vector2d& pixel) {
  Sight sight;
  sight.point = point.position;
  sight.uncertainty = point.uncertainty;
  sight.T_cam_map = T_cam_map;
  sight.camera = camera;
  sight.pixel = pixel;
  sight.sigma = 1.5 * store[point.keyframe].view.sigma(point.feature);
  return sight;
}

}  // namespace

double wrongProbability(const Evidence& evidence) {
  // Rooms that have walls in common and nothing else show a share of each other's points.
  const double above = evidence.views == 1 ? (evidence.share() - kSharedByView) / kSharedByViewSigma
                                           : (evidence.share() - kSharedWalls) / kSharedWallsSigma;
  const double by_share = 0.5 * std::erfc(above / std::sqrt(2.0));
  const double by_count = std::pow(10.0, std::min(0.0, 2 - 0.1 * evidence.found));
  return std::max({by_share, by_count, kLeastWrong});
}

std::optional<Recognition> recognize(const KeyframeStore& store,
                                     const Query& query,
                                     std::size_t keyframe) {
  const std::vector<StoredPoint> points = store.pointsOf(store.neighbourhood(keyframe, kReach));
  const Lookup lookup(query, pinholePixels(query));
  const Matched matched = matchPoints(store, points, *query.view);
  std::optional<SE3> pose =
      poseOfMost(points, matched, lookup, query.camera, store[keyframe].T_world_cam);
  Recognition result;
  for (int round = 0; pose && round < 2; ++round) {
    const Found found = findPredicted(store, points, query, lookup, *pose);
    std::vector<Sight> sights;
    for (const auto& [point, feature] : found.pairs) {
      sights.push_back(sightOf(store, points[point], SE3(), query.camera, lookup.pixel(feature)));
    }
    const std::optional<Alignment> alignment = align(sights, {*pose, 1}, false);
    if (!alignment) return std::nullopt;
    pose = alignment->S_a_b.motion;
    result.covariance = alignment->covariance.topLeftCorner<6, 6>();
  }
  if (!pose) return std::nullopt;
  const Found found = findPredicted(store, points, query, lookup, *pose);
  if (found.pairs.size() < kMinMatches || found.evidence.log_chance > kLogChance) {
    return std::nullopt;
  }
  result.keyframe = keyframe;
  result.T_view_world = *pose;
  result.evidence = found.evidence;
  result.evidence.views = 1;
  for (const auto& [point, feature] : found.pairs) {
    result.points.push_back(points[point]);
    result.features.push_back(feature);
  }
  return result;
}

namespace {

/// Unit of the recognized map in that of the view's own, by points that both know.
std::optional<double> scaleOf(const StoredKeyframe& view, const Recognition& recognition) {
  std::vector<double> ratios;
  for (std::size_t i = 0; i < recognition.points.size(); ++i) {
    const double inverse_depth = view.inverse_depths[recognition.features[i]];
    const double z = (recognition.T_view_world * recognition.points[i].position).z();
    if (inverse_depth > 0 && z > 0) ratios.push_back(z * inverse_depth);
  }
  if (ratios.size() < 5) return std::nullopt;
  return medianInPlace(ratios);
}

/// What cameras around one keyframe see of the points around another.
struct Seen {
  std::vector<Sight> sights;
  Evidence evidence;
};

Seen lookFrom(const KeyframeStore& store,
              const std::vector<std::size_t>& cameras,
              const std::vector<StoredPoint>& points,
              const Similarity& S_cameras_points) {
  Seen seen;
  for (const std::size_t k : cameras) {
    const StoredKeyframe& keyframe = store[k];
    const Query query{&keyframe.view, keyframe.camera, keyframe.radial};
    const Lookup lookup(query, pinholePixels(query));
    const SE3 T_cam_map = keyframe.T_world_cam.inverse();
    // The pose of a camera among points of another unit: lengths in the points' unit.
    const SE3 T_points_cam = S_cameras_points.inverse().moved(keyframe.T_world_cam);
    const Found found = findPredicted(store, points, query, lookup, T_points_cam.inverse());
    for (const auto& [point, feature] : found.pairs) {
      seen.sights.push_back(
          sightOf(store, points[point], T_cam_map, keyframe.camera, lookup.pixel(feature)));
    }
    Evidence& sum = seen.evidence;
    sum.predicted += found.evidence.predicted;
    sum.found += found.evidence.found;
    sum.chance += found.evidence.chance * found.evidence.predicted;
    if (found.evidence.log_chance < kLogChance) ++sum.views;
    sum.log_chance += found.evidence.log_chance;
    sum.cells = std::max(sum.cells, found.evidence.cells);
  }
  return seen;
}

Seen lookBothWays(const KeyframeStore& store,
                  std::size_t from,
                  std::size_t to,
                  const Similarity& S_to_from) {
  const std::vector<std::size_t> ours = store.neighbourhood(from, kReach);
  const std::vector<std::size_t> theirs = store.neighbourhood(to, kReach);
  Seen seen = lookFrom(store, theirs, store.pointsOf(ours), S_to_from);
  Seen back = lookFrom(store, ours, store.pointsOf(theirs), S_to_from.inverse());
  for (Sight& sight : back.sights) sight.backward = true;
  seen.sights.insert(seen.sights.end(), back.sights.begin(), back.sights.end());
  Evidence& sum = seen.evidence;
  sum.views += back.evidence.views;
  sum.predicted += back.evidence.predicted;
  sum.found += back.evidence.found;
  sum.chance += back.evidence.chance;
  sum.log_chance += back.evidence.log_chance;
  sum.cells = std::max(sum.cells, back.evidence.cells);
  if (sum.predicted > 0) sum.chance /= sum.predicted;
  return seen;
}

}  // namespace

std::optional<Link> link(const KeyframeStore& store,
                         std::size_t from,
                         const Recognition& recognition) {
  const StoredKeyframe& keyframe = store[from];
  const std::optional<double> scale = scaleOf(keyframe, recognition);
  if (!scale) return std::nullopt;
  Link result;
  result.from = from;
  result.to = recognition.keyframe;
  const SE3 T_to_view = recognition.T_view_world.inverse();
  result.S_to_from = Similarity{T_to_view, *scale} * Similarity{keyframe.T_world_cam.inverse(), 1};
  for (int round = 0; round < 3; ++round) {
    const Seen seen = lookBothWays(store, from, result.to, result.S_to_from);
    const std::optional<Alignment> alignment = align(seen.sights, result.S_to_from, true);
    if (!alignment) return std::nullopt;
    result.S_to_from = alignment->S_a_b;
    result.covariance = alignment->covariance;
    result.matches = static_cast<int>(alignment->inliers);
    result.evidence = seen.evidence;
  }
  result.wrong_probability = wrongProbability(result.evidence);
  return result;
}

}  // namespace dsorb::place
