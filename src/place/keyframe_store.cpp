// SPDX-License-Identifier: BSD-3-Clause
#include "place/keyframe_store.h"

#include "base/median.h"
#include "estimate/radial.h"
#include "features/feature_matches.h"
#include "features/grey_image.h"
#include "place/binary_matches.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <unordered_map>
#include <unordered_set>
#include <utility>

namespace dsorb::place {
namespace {

constexpr int kBorderOfInvalid = 15;        // half of what ORB describes [px]
constexpr std::size_t kLookBack = 4;        // keyframes that corners are followed to
constexpr std::ptrdiff_t kTrackReach = 12;  // keyframes that a track is looked for in, at once
constexpr double kLevelFactor = 1.2;        // between two levels of the detector's pyramid
constexpr double kCornerSigma = 0.8;        // of a corner's position on its level [px]
constexpr double kOutlier = 9.2;            // chi-square, 2 degrees of freedom, 99 %
constexpr double kMaxRelative = 0.25;       // standard deviation of an inverse depth over it
constexpr int kSteps = 4;                   // of Gauss-Newton

/// A corner of a track.
struct Sighting {
  std::size_t keyframe = 0;
  std::size_t feature = 0;
};

/// Point nearest to the rays of all sightings.
Eigen::Vector3d middleOfRays(const std::vector<StoredKeyframe>& keyframes,
                             const std::vector<Sighting>& track) {
  Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
  Eigen::Vector3d right = Eigen::Vector3d::Zero();
  for (const Sighting& s : track) {
    const StoredKeyframe& keyframe = keyframes[s.keyframe];
    const Eigen::Vector3d d =
        (keyframe.T_world_cam.unitQuaternion() * keyframe.ray(s.feature)).normalized();
    const Eigen::Matrix3d off = Eigen::Matrix3d::Identity() - d * d.transpose();
    sum += off;
    right += off * keyframe.T_world_cam.translation();
  }
  return sum.ldlt().solve(right);
}

struct Triangulated {
  Eigen::Vector3d position;
  Eigen::Matrix3d covariance;
};

/// @return whether every sighting agrees with the point
bool refinePoint(const std::vector<StoredKeyframe>& keyframes,
                 const std::vector<Sighting>& track,
                 Triangulated& point) {
  for (int step = 0; step <= kSteps; ++step) {
    Eigen::Matrix3d hessian = Eigen::Matrix3d::Zero();
    Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
    double worst = 0;
    for (const Sighting& s : track) {
      const StoredKeyframe& keyframe = keyframes[s.keyframe];
      const SE3 T_cam_world = keyframe.T_world_cam.inverse();
      const Eigen::Vector3d p = T_cam_world * point.position;
      if (!(p.z() > 0)) return false;
      const Eigen::Vector2d residual = keyframe.camera.project(p) - keyframe.pixel(s.feature);
      Eigen::Matrix<double, 2, 3> J;
      J << keyframe.camera.fx / p.z(), 0, -keyframe.camera.fx * p.x() / (p.z() * p.z()), 0,
          keyframe.camera.fy / p.z(), -keyframe.camera.fy * p.y() / (p.z() * p.z());
      J = J * T_cam_world.rotationMatrix();
      const double sigma = keyframe.view.sigma(s.feature);
      const double information = 1 / (sigma * sigma);
      hessian += information * J.transpose() * J;
      gradient += information * J.transpose() * residual;
      worst = std::max(worst, information * residual.squaredNorm());
    }
    if (step == kSteps) {
      point.covariance = hessian.inverse();
      return worst < kOutlier && point.covariance.allFinite();
    }
    point.position -= hessian.ldlt().solve(gradient);
    if (!point.position.allFinite()) return false;
  }
  return false;
}

void setDepth(StoredKeyframe& keyframe, std::size_t feature, const Triangulated& point) {
  const Eigen::Vector3d axis = keyframe.T_world_cam.rotationMatrix().col(2);
  const double z = axis.dot(point.position - keyframe.T_world_cam.translation());
  const double sigma = std::sqrt(axis.dot(point.covariance * axis));
  if (!(z > 0) || !(sigma < kMaxRelative * z)) return;
  keyframe.inverse_depths[feature] = static_cast<float>(1 / z);
  keyframe.sigmas[feature] = Eigen::half(static_cast<float>(sigma / (z * z)));
}

}  // namespace

double View::sigma(std::size_t feature) const {
  return kCornerSigma * std::pow(kLevelFactor, octaves[feature]);
}

View describeView(const Frame& frame) {
  const Features features =
      findFeatures(greyImage(frame.level(0), 1, kBorderOfInvalid), kViewFeatures);
  View view;
  const std::size_t count = features.points.size();
  view.descriptors.resize(count);
  view.pixels.reserve(count);
  view.octaves.reserve(count);
  for (std::size_t i = 0; i < count; ++i) {
    std::memcpy(view.descriptors[i].data(),
                features.descriptors.ptr(static_cast<int>(i)),
                sizeof(BinaryDescriptor));
    view.pixels.emplace_back(features.points[i].pt.x, features.points[i].pt.y);
    view.octaves.push_back(static_cast<std::uint8_t>(features.points[i].octave));
  }
  return view;
}

Eigen::Vector3d StoredKeyframe::ray(std::size_t feature) const {
  const Eigen::Vector3d seen = camera.unproject(view.pixels[feature].cast<double>());
  const Eigen::Vector2f ideal = unbend(radial, seen.head<2>().cast<float>());
  return radial == 0 ? seen : Eigen::Vector3d(ideal.x(), ideal.y(), 1);
}

Eigen::Vector2d StoredKeyframe::pixel(std::size_t feature) const {
  return radial == 0 ? Eigen::Vector2d(view.pixels[feature].cast<double>())
                     : camera.project(ray(feature));
}

std::size_t KeyframeStore::add(const KeyframeSnapshot& snapshot, View view, int stretch) {
  StoredKeyframe keyframe;
  keyframe.id = snapshot.id;
  keyframe.segment = snapshot.segment;
  keyframe.stretch = stretch;
  keyframe.view = std::move(view);
  keyframe.inverse_depths.assign(keyframe.view.size(), 0);
  keyframe.sigmas.assign(keyframe.view.size(), Eigen::half(0.0F));
  follow(keyframe);
  segments_[keyframe.segment].push_back(keyframes_.size());
  stretches_[keyframe.stretch].push_back(keyframes_.size());
  keyframes_.push_back(std::move(keyframe));
  update(keyframes_.size() - 1, snapshot);
  return keyframes_.size() - 1;
}

void KeyframeStore::append(std::vector<StoredKeyframe> keyframes) {
  const std::uint32_t first = next_track_;
  for (StoredKeyframe& keyframe : keyframes) {
    for (std::uint32_t& track : keyframe.tracks) {
      track += first;
      next_track_ = std::max(next_track_, track + 1);
    }
    segments_[keyframe.segment].push_back(keyframes_.size());
    stretches_[keyframe.stretch].push_back(keyframes_.size());
    keyframes_.push_back(std::move(keyframe));
  }
}

void KeyframeStore::update(std::size_t position, const KeyframeSnapshot& snapshot) {
  StoredKeyframe& keyframe = keyframes_[position];
  keyframe.timestamp = snapshot.timestamp;
  keyframe.T_world_cam = snapshot.T_world_cam;
  keyframe.camera = snapshot.camera;
  keyframe.radial = snapshot.radial ? static_cast<float>(snapshot.radial->k1) : 0;
}

void KeyframeStore::follow(StoredKeyframe& keyframe) {
  constexpr std::uint32_t kNone = UINT32_MAX;
  keyframe.tracks.assign(keyframe.view.size(), kNone);
  const std::vector<std::size_t>& before = stretches_[keyframe.stretch];
  std::unordered_set<std::uint32_t> taken;
  for (std::size_t back = 1; back <= std::min(kLookBack, before.size()); ++back) {
    const StoredKeyframe& earlier = keyframes_[before[before.size() - back]];
    const std::vector<int> partner =
        mutualMatches(keyframe.view.descriptors, earlier.view.descriptors);
    for (std::size_t i = 0; i < partner.size(); ++i) {
      if (partner[i] < 0 || keyframe.tracks[i] != kNone) continue;
      const std::uint32_t track = earlier.tracks[static_cast<std::size_t>(partner[i])];
      if (taken.insert(track).second) keyframe.tracks[i] = track;
    }
  }
  for (std::uint32_t& track : keyframe.tracks) {
    if (track == kNone) track = next_track_++;
  }
}

void KeyframeStore::triangulate(int stretch) {
  triangulateAll(stretches_[stretch], nullptr);
}

void KeyframeStore::triangulateAround(std::size_t keyframe) {
  const std::vector<std::size_t>& all = stretches_.at(keyframes_[keyframe].stretch);
  const auto end = std::upper_bound(all.begin(), all.end(), keyframe);
  const auto count = std::min<std::ptrdiff_t>(kTrackReach, end - all.begin());
  triangulateAll(std::vector<std::size_t>(end - count, end), &keyframes_[keyframe]);
}

void KeyframeStore::triangulateAll(const std::vector<std::size_t>& keyframes,
                                   const StoredKeyframe* only) {
  std::unordered_map<std::uint32_t, std::vector<Sighting>> tracks;
  if (only != nullptr) {
    for (const std::uint32_t track : only->tracks) tracks[track];
  }
  for (const std::size_t k : keyframes) {
    StoredKeyframe& keyframe = keyframes_[k];
    if (only == nullptr)
      std::fill(keyframe.inverse_depths.begin(), keyframe.inverse_depths.end(), 0.0F);
    for (std::size_t i = 0; i < keyframe.view.size(); ++i) {
      const auto track = only == nullptr ? tracks.try_emplace(keyframe.tracks[i]).first
                                         : tracks.find(keyframe.tracks[i]);
      if (track != tracks.end()) track->second.push_back({k, i});
    }
  }
  for (const auto& [number, track] : tracks) {
    if (track.size() < 2) continue;
    Triangulated point{middleOfRays(keyframes_, track), {}};
    if (!refinePoint(keyframes_, track, point)) continue;
    for (const Sighting& s : track) setDepth(keyframes_[s.keyframe], s.feature, point);
  }
}

void KeyframeStore::move(std::size_t position, const Similarity& S_new_old) {
  StoredKeyframe& keyframe = keyframes_[position];
  keyframe.T_world_cam = S_new_old.moved(keyframe.T_world_cam);
  const auto scale = static_cast<float>(S_new_old.scale);
  for (std::size_t i = 0; i < keyframe.view.size(); ++i) {
    keyframe.inverse_depths[i] /= scale;
    keyframe.sigmas[i] = Eigen::half(static_cast<float>(keyframe.sigmas[i]) / scale);
  }
}

void KeyframeStore::move(int segment, int into, const Similarity& S_into_segment) {
  for (const std::size_t k : segments_[segment]) {
    move(k, S_into_segment);
    keyframes_[k].segment = into;
  }
  if (segment == into) return;
  std::vector<std::size_t>& all = segments_[into];
  all.insert(all.end(), segments_[segment].begin(), segments_[segment].end());
  std::sort(all.begin(), all.end());
  segments_.erase(segment);
}

bool KeyframeStore::shareTracks(std::size_t a, std::size_t b) const {
  const std::vector<std::uint32_t>& tracks = keyframes_[a].tracks;
  const std::unordered_set<std::uint32_t> ours(tracks.begin(), tracks.end());
  const std::vector<std::uint32_t>& others = keyframes_[b].tracks;
  return std::any_of(
      others.begin(), others.end(), [&](std::uint32_t track) { return ours.count(track) > 0; });
}

std::vector<MapTrack> KeyframeStore::tracks(int first_stretch) const {
  std::unordered_map<std::uint32_t, std::size_t> numbers;
  std::vector<MapTrack> all;
  for (const StoredKeyframe& keyframe : keyframes_) {
    if (keyframe.stretch < first_stretch) continue;
    for (std::size_t i = 0; i < keyframe.view.size(); ++i) {
      if (!(keyframe.inverse_depths[i] > 0)) continue;
      const auto [found, is_new] = numbers.try_emplace(keyframe.tracks[i], all.size());
      if (is_new) all.push_back({keyframe.segment, Eigen::Vector3d::Zero(), {}});
      MapTrack& track = all[found->second];
      track.position += keyframe.T_world_cam *
                        (keyframe.ray(i) / static_cast<double>(keyframe.inverse_depths[i]));
      track.sights.push_back({keyframe.id, keyframe.pixel(i).cast<float>()});
    }
  }
  for (MapTrack& track : all) track.position /= static_cast<double>(track.sights.size());
  all.erase(
      std::remove_if(all.begin(), all.end(), [](const MapTrack& t) { return t.sights.size() < 2; }),
      all.end());
  return all;
}

double KeyframeStore::medianInverseDepth(std::size_t keyframe) const {
  std::vector<float> known;
  for (const float inverse_depth : keyframes_[keyframe].inverse_depths) {
    if (inverse_depth > 0) known.push_back(inverse_depth);
  }
  return static_cast<double>(medianInPlace(known));
}

std::vector<std::size_t> KeyframeStore::neighbourhood(std::size_t keyframe,
                                                      std::size_t reach) const {
  const std::vector<std::size_t>& all = stretches_.at(keyframes_[keyframe].stretch);
  const auto place =
      static_cast<std::size_t>(std::lower_bound(all.begin(), all.end(), keyframe) - all.begin());
  std::vector<std::size_t> found = {keyframe};
  for (std::size_t step = 1; step <= reach; ++step) {
    if (step <= place) found.push_back(all[place - step]);
    if (place + step < all.size()) found.push_back(all[place + step]);
  }
  return found;
}

std::vector<StoredPoint> KeyframeStore::pointsOf(const std::vector<std::size_t>& keyframes) const {
  std::vector<StoredPoint> points;
  std::unordered_set<std::uint32_t> seen;
  for (const std::size_t k : keyframes) {
    const StoredKeyframe& keyframe = keyframes_[k];
    for (std::size_t i = 0; i < keyframe.view.size(); ++i) {
      const double inverse_depth = keyframe.inverse_depths[i];
      if (!(inverse_depth > 0) || !seen.insert(keyframe.tracks[i]).second) continue;
      const Eigen::Vector3d ray = keyframe.ray(i);
      const double moved =
          static_cast<double>(keyframe.sigmas[i]) / (inverse_depth * inverse_depth);
      points.push_back({keyframe.T_world_cam * (ray / inverse_depth),
                        keyframe.T_world_cam.unitQuaternion() * (moved * ray),
                        k,
                        i});
    }
  }
  return points;
}

std::size_t KeyframeStore::bytes() const {
  std::size_t sum = 0;
  for (const StoredKeyframe& keyframe : keyframes_) {
    const View& view = keyframe.view;
    sum += sizeof(keyframe) + view.descriptors.capacity() * sizeof(BinaryDescriptor) +
           view.pixels.capacity() * sizeof(Eigen::Vector2f) + view.octaves.capacity() +
           keyframe.tracks.capacity() * sizeof(std::uint32_t) +
           keyframe.inverse_depths.capacity() * sizeof(float) +
           keyframe.sigmas.capacity() * sizeof(Eigen::half);
  }
  return sum;
}

}  // namespace dsorb::place
