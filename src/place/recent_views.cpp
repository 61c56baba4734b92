// SPDX-License-Identifier: BSD-3-Clause
#include "place/recent_views.h"

#include "base/median.h"
#include "base/parallel.h"
#include "features/feature_matches.h"
#include "features/pose_from_matches.h"
#include "features/scale_features.h"
#include "image/cell_grid.h"
#include "image/image_scale.h"
#include "place/appearance.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <set>
#include <utility>

namespace dsorb::place {
namespace {

constexpr std::size_t kShared = 3;  // views before and after, whose points a view shows, too
constexpr std::size_t kAtOnce = 4;  // views that are described for one frame
constexpr int kPatience = 4;        // frames that are looked for in vain
static_assert(kPatience * kAtOnce >= RecentViews::kViews, "all views are asked");
constexpr std::size_t kBlind = 4;     // times fewer corners than the newest view: covered, blurred
constexpr int kCorners = 1000;        // of a view
constexpr int kLevel = 1;             // of the pyramid, on which they are found
constexpr int kMargin = 8;            // of invalid pixels [px]
constexpr std::size_t kMinSeen = 20;  // corners of the frame that agree with its pose
/// Cells of a view that these corners lie in at the end. A repeated wallpaper was taken for another
/// stretch of itself with 5, two poses that were wrong by degrees had 13 and 14, right ones 19
/// to 32.
constexpr std::size_t kMinCells = 16;
constexpr double kNear = 12;          // of a corner to where a pose shows its point, the same [px]
constexpr float kSameCorner = 0.7F;   // distance of the descriptors of one corner at most [-]
constexpr int kRounds = 2;            // of corners that a pose leads to, after the first
constexpr float kMaxToDepth = 8;      // of a corner to a point, for 800 px [px]
constexpr double kDepthSigma = 0.05;  // of a depth taken from there, of the depth
constexpr std::uint64_t kSampleSeed = 48;
/// Share of the cells that look otherwise at most. Views of rooms that have the same walls and
/// other furniture have .19 and more, one in twelve .12 to .18, one in 168 less; those of the same
/// place have 0 to .15, from far aside .2.
constexpr double kMaxContradicted = 0.12;
constexpr int kPatch = 4;                // pixels around a corner that have its depth [px]
constexpr std::size_t kLinkSpacing = 2;  // views of another segment from one query to the next
constexpr std::size_t kMinRatios = 10;   // corners whose depth both segments know
constexpr double kMedianLoss = 1.25;     // standard deviation of a median over that of a mean

Features describe(const GreyImage& image) {
  Features features = findScaleFeatures(image, kCorners);
  constexpr float kScale = 1 << kLevel;
  for (cv::KeyPoint& point : features.points) {
    point.pt = kScale * (point.pt + cv::Point2f(0.5F, 0.5F)) - cv::Point2f(0.5F, 0.5F);
  }
  return features;
}

GreyImage imageOf(const Frame& frame) {
  return greyImage(frame.level(kLevel), 1, kMargin);
}

/// Depths of points around a keyframe as it sees them, by pixel.
class DepthLookup {
 public:
  DepthLookup(const std::vector<DepthSample>& depths, const PinholeCamera& camera)
      : depths_(depths),
        radius_(kMaxToDepth * static_cast<float>(imageScale(camera.width, camera.height))),
        grid_(pixelsOf(depths), CellGrid(camera.width, camera.height, radius_)) {}
  /// Inverse depth of the nearest point, 0 where none is near [1/unit].
  [[nodiscard]] double at(const Eigen::Vector2f& pixel) const {
    const auto sample = grid_.nearest<1>(pixel, radius_);
    if (sample.count == 0) return 0;
    return static_cast<double>(depths_[sample.nearest[0].point].inverse_depth);
  }

 private:
  static std::vector<Eigen::Vector2f> pixelsOf(const std::vector<DepthSample>& depths) {
    std::vector<Eigen::Vector2f> pixels;
    pixels.reserve(depths.size());
    for (const DepthSample& sample : depths) pixels.push_back(sample.pixel);
    return pixels;
  }

  const std::vector<DepthSample>& depths_;
  float radius_;
  PointGrid grid_;
};

/// What the views around one show of their points, in it.
std::vector<DepthSample> depthsOf(const std::deque<RecentView>& views, std::size_t view) {
  const KeyframeSnapshot& at = *views[view].keyframe;
  const SE3 T_cam_world = at.T_world_cam.inverse();
  std::vector<DepthSample> depths;
  const std::size_t end = std::min(views.size(), view + kShared + 1);
  for (std::size_t i = view - std::min(view, kShared); i < end; ++i) {
    const std::optional<KeyframeSnapshot>& host = views[i].keyframe;
    if (!host || host->segment != at.segment) continue;
    const SE3 T_cam_host = T_cam_world * host->T_world_cam;
    for (const MapPoint& point : host->points) {
      if (!(point.inverse_depth > 0)) continue;
      const Eigen::Vector3d p = T_cam_host * (host->camera.unproject(point.pixel.cast<double>()) /
                                              static_cast<double>(point.inverse_depth));
      if (!(p.z() > 0)) continue;
      const Eigen::Vector2d pixel = at.camera.project(p);
      if (!at.camera.contains(pixel)) continue;
      depths.push_back({pixel.cast<float>(), static_cast<float>(1 / p.z()), 1});
    }
  }
  return depths;
}

/// Calls call(i) for each view, in parallel.
template <typename Call>
void forEachView(const std::deque<RecentView>& views, const Call& call) {
  forEachRange(views.size(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) call(i);
  });
}

/// Describes some of those that are not yet, spaced, the newest first.
void describeSome(std::deque<RecentView>& views, std::size_t count) {
  constexpr std::size_t kSpacing = RecentViews::kViews / kAtOnce;
  std::vector<RecentView*> next;
  for (std::size_t offset = 1; offset <= kSpacing; ++offset) {
    for (std::size_t back = offset; back <= views.size(); back += kSpacing) {
      RecentView& view = views[views.size() - back];
      if (!view.is_described && next.size() < count) next.push_back(&view);
    }
  }
  forEachRange(next.size(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      next[i]->features = describe(next[i]->image);
      next[i]->is_described = true;
    }
  });
}

/// Features of a view that are near a point, and where they are in the world.
struct Located {
  Features features;
  std::vector<Eigen::Vector3d> points;
};

Located locate(const std::deque<RecentView>& views, std::size_t view) {
  const Features& features = views[view].features;
  const KeyframeSnapshot& keyframe = *views[view].keyframe;
  const std::vector<DepthSample> depths = depthsOf(views, view);
  const DepthLookup lookup(depths, keyframe.camera);
  Located located;
  for (std::size_t i = 0; i < features.points.size(); ++i) {
    const cv::Point2f& pixel = features.points[i].pt;
    const double inverse_depth = lookup.at({pixel.x, pixel.y});
    if (inverse_depth == 0) continue;
    located.features.points.push_back(features.points[i]);
    located.features.descriptors.push_back(features.descriptors.row(static_cast<int>(i)));
    located.points.push_back(keyframe.T_world_cam *
                             (keyframe.camera.unproject({pixel.x, pixel.y}) / inverse_depth));
  }
  return located;
}

/// The features of each view; none where it is not of the segment.
std::vector<Located> locateAll(const std::deque<RecentView>& views, int segment) {
  std::vector<Located> located(views.size());
  forEachView(views, [&](std::size_t i) {
    const std::optional<KeyframeSnapshot>& told = views[i].keyframe;
    if (!views[i].is_described || !told || told->segment != segment) return;
    located[i] = locate(views, i);
  });
  return located;
}

/// Corners of the frame and points of the map, in the world.
struct Pairs {
  std::vector<Eigen::Vector3d> points;
  std::vector<Eigen::Vector2d> pixels;
};

/// Where a frame is taken to be.
struct FramePose {
  PinholeCamera camera;
  SE3 T_cam_world;
};

/// Distances of points to the corners near where a pose shows them.
Distances distancesNear(const Located& view,
                        const Features& frame,
                        const std::vector<Eigen::Vector2f>& corners,
                        const FramePose& pose) {
  Distances distances(view.points.size(), corners.size());
  const double radius = kNear * imageScale(pose.camera.width, pose.camera.height);
  for (std::size_t i = 0; i < view.points.size(); ++i) {
    const Eigen::Vector3d p = pose.T_cam_world * view.points[i];
    if (!(p.z() > 0)) continue;
    const Eigen::Vector2d place = pose.camera.project(p);
    for (std::size_t j = 0; j < corners.size(); ++j) {
      if (!((corners[j].cast<double>() - place).norm() < radius)) continue;
      const float distance = scaleDistance(view.features, i, frame, j);
      if (distance <= kSameCorner) distances.row(i)[j] = distance;
    }
  }
  return distances;
}

/// @param guess of the frame; else its corners are looked for everywhere
void addPairs(const Located& view,
              const Features& frame,
              const std::vector<Eigen::Vector2f>& corners,
              const std::optional<FramePose>& guess,
              Pairs& pairs) {
  if (view.points.empty()) return;
  const Distances distances =
      guess ? distancesNear(view, frame, corners, *guess) : scaleDistances(view.features, frame);
  const std::vector<int> partner =
      partnersOf(distances, corners, kMaxRatio, std::numeric_limits<float>::max());
  for (std::size_t i = 0; i < partner.size(); ++i) {
    if (partner[i] < 0) continue;
    pairs.points.push_back(view.points[i]);
    pairs.pixels.emplace_back(corners[static_cast<std::size_t>(partner[i])].cast<double>());
  }
}

/// A view among others.
struct Placed {
  std::size_t host = 0;  // the view that shows most of it
  SE3 T_world_cam;
  SE3 T_cam_host;
  Matrix6d covariance;                   // of exp(xi) * T_cam_host
  std::vector<Eigen::Vector2f> corners;  // that agree [px]
  std::vector<double> depths;            // of these, in the unit of the world
};

/// The pose that most agree with.
/// @param T_world_host of a camera that has the points before it
/// @param min_cells    that corners which agree lie in
std::optional<Placed> placeOfMost(const Pairs& pairs,
                                  const PinholeCamera& camera,
                                  const SE3& T_world_host,
                                  std::size_t min_cells) {
  const SE3 T_host_world = T_world_host.inverse();
  std::vector<PointObservation> matches;
  for (std::size_t i = 0; i < pairs.points.size(); ++i) {
    const Eigen::Vector3d p = T_host_world * pairs.points[i];
    if (p.z() > 0) matches.push_back({p / p.z(), 1 / p.z(), pairs.pixels[i]});
  }
  const std::optional<MatchedPose> pose = poseFromMatches(matches, camera, kSampleSeed);
  if (!pose) return std::nullopt;
  Placed placed;
  placed.T_world_cam = T_world_host * pose->T_cam_host.inverse();
  placed.T_cam_host = pose->T_cam_host;
  placed.covariance = pose->covariance;
  std::set<std::pair<double, double>> seen;
  std::set<std::size_t> covered;
  const CellGrid cells = viewCells(camera);
  for (std::size_t i = 0; i < matches.size(); ++i) {
    const PointObservation& match = matches[i];
    if (pose->inlier[i] == 0 || !seen.emplace(match.pixel.x(), match.pixel.y()).second) continue;
    covered.insert(cells.at(match.pixel.x(), match.pixel.y()));
    placed.corners.emplace_back(match.pixel.cast<float>());
    placed.depths.push_back((pose->T_cam_host * (match.host_ray / match.inverse_depth)).z());
  }
  if (seen.size() < kMinSeen || covered.size() < min_cells) return std::nullopt;
  return placed;
}

bool hasFewer(const Pairs& a, const Pairs& b) {
  return a.points.size() < b.points.size();
}

Pairs allOf(const std::vector<Pairs>& parts) {
  Pairs all;
  for (const Pairs& part : parts) {
    all.points.insert(all.points.end(), part.points.begin(), part.points.end());
    all.pixels.insert(all.pixels.end(), part.pixels.begin(), part.pixels.end());
  }
  return all;
}

/// Whether an image shows other things than the points of the views where a pose has them.
bool isContradicted(const std::deque<RecentView>& views,
                    int segment,
                    const GreyImage& image,
                    const PinholeCamera& camera,
                    const Placed& placed) {
  std::vector<ImagedKeyframe> keyframes;
  for (const RecentView& view : views) {
    if (!view.keyframe || view.keyframe->segment != segment) continue;
    keyframes.push_back({&*view.keyframe, view.image.grey});
  }
  return contradictedShare(keyframes, image, camera, placed.T_world_cam, placed.corners) >
         kMaxContradicted;
}

/// Where features are seen among views; after a first pose they are looked for near it.
std::optional<Placed> search(const std::deque<RecentView>& views,
                             const std::vector<Located>& located,
                             const Features& features,
                             const PinholeCamera& camera) {
  const std::vector<Eigen::Vector2f> corners = positionsOf(features);
  std::optional<Placed> placed;
  for (int round = 0; round <= kRounds; ++round) {
    std::optional<FramePose> guess;
    if (placed) guess = FramePose{camera, placed->T_world_cam.inverse()};
    std::vector<Pairs> found(views.size());
    forEachView(views,
                [&](std::size_t i) { addPairs(located[i], features, corners, guess, found[i]); });
    const auto most = static_cast<std::size_t>(
        std::max_element(found.begin(), found.end(), hasFewer) - found.begin());
    if (!views[most].keyframe) return std::nullopt;
    placed = placeOfMost(
        allOf(found), camera, views[most].keyframe->T_world_cam, round == kRounds ? kMinCells : 0);
    if (!placed) return std::nullopt;
    placed->host = most;
  }
  return placed;
}

/// Length of a view's own unit in that of the world where it was placed.
struct Unit {
  double scale = 1;
  double log_variance = 0;
};

std::optional<Unit> unitOf(const Placed& placed, const DepthLookup& own) {
  std::vector<double> logs;
  for (std::size_t i = 0; i < placed.corners.size(); ++i) {
    const double inverse_depth = own.at(placed.corners[i]);
    if (inverse_depth > 0) logs.push_back(std::log(placed.depths[i] * inverse_depth));
  }
  if (logs.size() < kMinRatios) return std::nullopt;
  const double median = medianInPlace(logs);
  for (double& value : logs) value = std::abs(value - median);
  const double deviation = kMedianLoss * kMadToSigma * medianInPlace(logs);
  return Unit{std::exp(median), deviation * deviation / static_cast<double>(logs.size())};
}

}  // namespace

std::optional<RecentView> viewOf(FrameId id, const Frame& frame) {
  if (frame.pyramid().levels() <= kLevel) return std::nullopt;
  return RecentView{id, {}, imageOf(frame), {}};
}

void RecentViews::add(const RecentView& view) {
  views_.push_back(view);
  if (views_.size() > kViews) views_.pop_front();
  asked_ = 0;
}

void RecentViews::tell(const KeyframeSnapshot& keyframe) {
  for (RecentView& view : views_) {
    if (view.id == keyframe.id) view.keyframe = keyframe;
  }
}

std::optional<int> RecentViews::segment() const {
  const auto newest = std::find_if(views_.rbegin(), views_.rend(), [](const RecentView& view) {
    return view.keyframe.has_value();
  });
  if (newest == views_.rend()) return std::nullopt;
  return newest->keyframe->segment;
}

std::optional<RecognizedPlace> RecentViews::find(const Frame& frame, const PinholeCamera& camera) {
  const std::optional<int> segment = this->segment();
  if (asked_ >= kPatience || !segment) return std::nullopt;
  describeSome(views_, kAtOnce);
  const GreyImage image = imageOf(frame);
  const Features features = describe(image);
  if (kBlind * features.points.size() < views_.back().features.points.size()) return std::nullopt;
  ++asked_;
  const std::optional<Placed> placed =
      search(views_, locateAll(views_, *segment), features, camera);
  if (!placed || isContradicted(views_, *segment, image, camera, *placed)) {
    return std::nullopt;
  }
  asked_ = 0;
  RecognizedPlace place;
  place.segment = *segment;
  place.T_world_cam = placed->T_world_cam;
  place.keyframe = views_[placed->host].id;
  place.T_cam_keyframe = placed->T_cam_host;
  place.covariance = placed->covariance;
  for (std::size_t i = 0; i < placed->corners.size(); ++i) {
    const double z = placed->depths[i];
    addDepth(placed->corners[i], z, kDepthSigma * z, place);
  }
  return place;
}

std::vector<Link> RecentViews::linksTo(RecentViews& others,
                                       const std::map<FrameId, std::size_t>& positions) {
  std::vector<Link> links;
  const std::optional<int> segment = this->segment();
  if (!segment) return links;
  describeSome(views_, kViews);
  describeSome(others.views_, kViews);
  const std::vector<Located> located = locateAll(views_, *segment);
  for (std::size_t i = 0; i < others.views_.size(); i += kLinkSpacing) {
    const RecentView& view = others.views_[i];
    if (!view.keyframe) continue;
    const PinholeCamera& camera = view.keyframe->camera;
    const std::optional<Placed> placed = search(views_, located, view.features, camera);
    if (!placed || isContradicted(views_, *segment, view.image, camera, *placed)) continue;
    const std::vector<DepthSample> depths = depthsOf(others.views_, i);
    const std::optional<Unit> unit = unitOf(*placed, DepthLookup(depths, camera));
    if (!unit) continue;
    Link link;
    link.from = positions.at(view.id);
    link.to = positions.at(views_[placed->host].id);
    link.S_to_from = Similarity{placed->T_world_cam, unit->scale} *
                     Similarity{view.keyframe->T_world_cam.inverse(), 1};
    Matrix7d covariance = Matrix7d::Zero();
    covariance.topLeftCorner<6, 6>() = placed->covariance;
    covariance(6, 6) = unit->log_variance;
    const Matrix7d adjoint = Similarity{placed->T_world_cam, 1}.adjoint();
    link.covariance = adjoint * covariance * adjoint.transpose();
    link.matches = static_cast<int>(placed->corners.size());
    links.push_back(link);
  }
  return links;
}

void addDepth(const Eigen::Vector2f& pixel, double depth, double sigma, RecognizedPlace& place) {
  for (int dy = -kPatch; dy <= kPatch; ++dy) {
    for (int dx = -kPatch; dx <= kPatch; ++dx) {
      place.depths.push_back({pixel.x() + static_cast<float>(dx),
                              pixel.y() + static_cast<float>(dy),
                              static_cast<float>(depth),
                              static_cast<float>(sigma)});
    }
  }
}

}  // namespace dsorb::place
