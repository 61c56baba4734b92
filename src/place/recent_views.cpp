// SPDX-License-Identifier: BSD-3-Clause
#include "place/recent_views.h"

#include "base/parallel.h"
#include "features/feature_matches.h"
#include "features/pose_from_matches.h"
#include "features/scale_features.h"
#include "image/cell_grid.h"
#include "image/image_scale.h"

#include <algorithm>
#include <cstdint>
#include <limits>
#include <set>
#include <utility>

namespace dsorb::place {
namespace {

constexpr std::size_t kViews = 16;    // that are remembered
constexpr std::size_t kShared = 3;    // views before and after, whose points a view shows, too
constexpr int kPatience = 4;          // frames that are looked for in vain
constexpr std::size_t kBlind = 4;     // times fewer corners than the newest view: covered, blurred
constexpr int kCorners = 1000;        // of a view
constexpr int kLevel = 1;             // of the pyramid, on which they are found
constexpr int kMargin = 8;            // of invalid pixels [px]
constexpr std::size_t kMinSeen = 20;  // corners of the frame that agree with its pose
/// Cells of 48 that these corners lie in at the end. A repeated wallpaper was taken for another
/// stretch of itself with 5, two poses that were wrong by degrees had 13 and 14, right ones 19
/// to 32.
constexpr std::size_t kMinCells = 16;
constexpr int kColumns = 8;
constexpr int kRows = 6;
constexpr double kNear = 12;          // of a corner to where a pose shows its point, the same [px]
constexpr float kSameCorner = 0.7F;   // distance of the descriptors of one corner at most [-]
constexpr int kRounds = 2;            // of corners that a pose leads to, after the first
constexpr float kMaxToDepth = 8;      // of a corner to a point, for 800 px [px]
constexpr double kDepthSigma = 0.05;  // of a depth taken from there, of the depth
constexpr std::uint64_t kSampleSeed = 48;
constexpr int kPatch = 4;  // pixels around a corner that have its depth [px]

Features describe(const GreyImage& image) {
  Features features = findScaleFeatures(image, kCorners);
  constexpr float kStep = 1 << kLevel;
  for (cv::KeyPoint& point : features.points) {
    point.pt = kStep * (point.pt + cv::Point2f(0.5F, 0.5F)) - cv::Point2f(0.5F, 0.5F);
  }
  return features;
}

GreyImage imageOf(const Frame& frame) {
  return greyImage(frame.level(kLevel), 1, kMargin);
}

/// Features of a view that are near a point, and where they are in the world.
struct Located {
  Features features;
  std::vector<Eigen::Vector3d> points;
};

Located locate(const Features& features,
               const std::vector<DepthSample>& depths,
               const KeyframeSnapshot& keyframe) {
  const PinholeCamera& camera = keyframe.camera;
  const auto radius = kMaxToDepth * static_cast<float>(imageScale(camera.width, camera.height));
  std::vector<Eigen::Vector2f> pixels;
  pixels.reserve(depths.size());
  for (const DepthSample& sample : depths) pixels.push_back(sample.pixel);
  const PointGrid grid(std::move(pixels), CellGrid(camera.width, camera.height, radius));
  Located located;
  for (std::size_t i = 0; i < features.points.size(); ++i) {
    const cv::Point2f& pixel = features.points[i].pt;
    const auto sample = grid.nearest<1>({pixel.x, pixel.y}, radius);
    if (sample.count == 0) continue;
    located.features.points.push_back(features.points[i]);
    located.features.descriptors.push_back(features.descriptors.row(static_cast<int>(i)));
    const float inverse_depth = depths[sample.nearest[0].point].inverse_depth;
    located.points.push_back(keyframe.T_world_cam * (camera.unproject({pixel.x, pixel.y}) /
                                                     static_cast<double>(inverse_depth)));
  }
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

/// Leaves the distances of points to corners near where a pose shows them.
void keepNear(const std::vector<Eigen::Vector3d>& points,
              const std::vector<Eigen::Vector2f>& corners,
              const FramePose& pose,
              Distances& distances) {
  const double radius = kNear * imageScale(pose.camera.width, pose.camera.height);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector3d p = pose.T_cam_world * points[i];
    const Eigen::Vector2d place = pose.camera.project(p);
    float* row = distances.row(i);
    for (std::size_t j = 0; j < corners.size(); ++j) {
      const bool is_near = p.z() > 0 && (corners[j].cast<double>() - place).norm() < radius;
      if (!is_near || row[j] > kSameCorner) row[j] = Distances::kNone;
    }
  }
}

/// @param guess of the frame; else its corners are looked for everywhere
void addPairs(const Located& view,
              const Features& frame,
              const std::vector<Eigen::Vector2f>& corners,
              const std::optional<FramePose>& guess,
              Pairs& pairs) {
  if (view.points.empty()) return;
  Distances distances = scaleDistances(view.features, frame);
  if (guess) keepNear(view.points, corners, *guess, distances);
  const std::vector<int> partner =
      partnersOf(distances, corners, kMaxRatio, std::numeric_limits<float>::max());
  for (std::size_t i = 0; i < partner.size(); ++i) {
    if (partner[i] < 0) continue;
    pairs.points.push_back(view.points[i]);
    pairs.pixels.emplace_back(corners[static_cast<std::size_t>(partner[i])].cast<double>());
  }
}

/// The pose that most agree with.
/// @param T_world_host of a camera that has the points before it
/// @param min_cells    that corners which agree lie in
std::optional<RecognizedPlace> placeOfMost(const Pairs& pairs,
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
  RecognizedPlace place;
  place.T_world_cam = T_world_host * pose->T_cam_host.inverse();
  place.T_cam_keyframe = pose->T_cam_host;
  place.covariance = pose->covariance;
  std::set<std::pair<double, double>> seen;
  std::set<std::size_t> covered;
  const CellGrid cells(camera.width, camera.height, kColumns, kRows);
  for (std::size_t i = 0; i < matches.size(); ++i) {
    const PointObservation& match = matches[i];
    if (pose->inlier[i] == 0 || !seen.emplace(match.pixel.x(), match.pixel.y()).second) continue;
    covered.insert(cells.at(match.pixel.x(), match.pixel.y()));
    const double z = (pose->T_cam_host * (match.host_ray / match.inverse_depth)).z();
    addDepth(match.pixel.cast<float>(), z, kDepthSigma * z, place);
  }
  if (seen.size() < kMinSeen || covered.size() < min_cells) return std::nullopt;
  return place;
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

}  // namespace

void RecentViews::add(FrameId id, const Frame& frame) {
  if (frame.pyramid().levels() <= kLevel) return;
  views_.push_back({id, {}, imageOf(frame), {}});
  if (views_.size() > kViews) views_.pop_front();
  asked_ = 0;
}

void RecentViews::tell(const KeyframeSnapshot& keyframe) {
  for (RecentView& view : views_) {
    if (view.id == keyframe.id) view.keyframe = keyframe;
  }
}

std::vector<DepthSample> RecentViews::depthsOf(std::size_t view) const {
  const KeyframeSnapshot& at = *views_[view].keyframe;
  const SE3 T_cam_world = at.T_world_cam.inverse();
  std::vector<DepthSample> depths;
  const std::size_t end = std::min(views_.size(), view + kShared + 1);
  for (std::size_t i = view - std::min(view, kShared); i < end; ++i) {
    const std::optional<KeyframeSnapshot>& host = views_[i].keyframe;
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

void RecentViews::describe() {
  forEachRange(views_.size(), 1, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      if (views_[i].image.grey.empty()) continue;
      views_[i].features = place::describe(views_[i].image);
      views_[i].image = {};
    }
  });
}

std::optional<RecognizedPlace> RecentViews::find(const Frame& frame, const PinholeCamera& camera) {
  if (asked_ >= kPatience || views_.empty()) return std::nullopt;
  describe();
  const Features features = place::describe(imageOf(frame));
  if (kBlind * features.points.size() < views_.back().features.points.size()) return std::nullopt;
  ++asked_;
  const auto newest = std::find_if(views_.rbegin(), views_.rend(), [](const RecentView& view) {
    return view.keyframe.has_value();
  });
  if (newest == views_.rend()) return std::nullopt;
  const int segment = newest->keyframe->segment;
  std::vector<Located> views(views_.size());
  const auto for_each_view = [this](const auto& call) {
    forEachRange(views_.size(), 1, [&](std::size_t begin, std::size_t end) {
      for (std::size_t i = begin; i < end; ++i) call(i);
    });
  };
  for_each_view([&](std::size_t i) {
    const std::optional<KeyframeSnapshot>& told = views_[i].keyframe;
    if (told && told->segment == segment) {
      views[i] = locate(views_[i].features, depthsOf(i), *told);
    }
  });
  const std::vector<Eigen::Vector2f> corners = positionsOf(features);
  std::optional<RecognizedPlace> place;
  for (int round = 0; round <= kRounds; ++round) {
    std::optional<FramePose> guess;
    if (place) guess = FramePose{camera, place->T_world_cam.inverse()};
    std::vector<Pairs> found(views_.size());
    for_each_view([&](std::size_t i) { addPairs(views[i], features, corners, guess, found[i]); });
    const auto most = std::max_element(found.begin(), found.end(), hasFewer) - found.begin();
    const RecentView& host = views_[static_cast<std::size_t>(most)];
    if (!host.keyframe) return std::nullopt;
    place = placeOfMost(
        allOf(found), camera, host.keyframe->T_world_cam, round == kRounds ? kMinCells : 0);
    if (!place) return std::nullopt;
    place->keyframe = host.id;
  }
  asked_ = 0;
  place->segment = segment;
  return place;
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
