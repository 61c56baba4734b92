// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/similarity.h"
#include "dsorb/image/frame.h"
#include "dsorb/odometry/observer.h"

#include "place/binary_index.h"

#include <Eigen/Core>

#include <cstddef>
#include <cstdint>
#include <map>
#include <vector>

namespace dsorb::place {

constexpr int kViewFeatures = 420;  ///< corners kept of an image; 2,000 keyframes in 60 MB

/// What is remembered of an image: corners with their descriptors, the strongest first.
struct View {
  std::vector<BinaryDescriptor> descriptors;
  std::vector<Eigen::Vector2f> pixels;  ///< [px]
  std::vector<std::uint8_t> octaves;    ///< levels of the detector's pyramid

  [[nodiscard]] std::size_t size() const { return descriptors.size(); }
  /// Standard deviation of a corner's position, each axis [px].
  [[nodiscard]] double sigma(std::size_t feature) const;
};

/// Finds the corners of a frame.
[[nodiscard]] View describeView(const Frame& frame);

/// A keyframe without its image.
struct StoredKeyframe {
  FrameId id;
  double timestamp = 0;  ///< [s]
  int segment = 0;       ///< whose world it lies in
  int stretch = 0;       ///< start that it was tracked from
  SE3 T_world_cam;
  PinholeCamera camera;
  float radial = 0;  ///< first coefficient of RadTan, which the images have beside the camera
  View view;
  std::vector<std::uint32_t> tracks;  ///< number of each feature's track, unique in the store
  // Inverse depth of each feature, and its sigma [1/unit]; 0: the depth is not known.
  std::vector<float> inverse_depths;
  std::vector<Eigen::half> sigmas;

  /// Ray through a feature, scaled to z = 1.
  [[nodiscard]] Eigen::Vector3d ray(std::size_t feature) const;
  /// Where a pinhole camera sees a feature [px].
  [[nodiscard]] Eigen::Vector2d pixel(std::size_t feature) const;
};

/// A point of the map as a keyframe has it.
struct StoredPoint {
  Eigen::Vector3d position;     ///< in the world of the keyframe's segment
  Eigen::Vector3d uncertainty;  ///< the same moved by one standard deviation of its depth, less it
  std::size_t keyframe = 0;
  std::size_t feature = 0;
};

/// The keyframes of a run, compact, in the order in which they came.
class KeyframeStore {
 public:
  /// Enters a keyframe and follows its corners back to those before it in its stretch.
  /// @return its position
  std::size_t add(const KeyframeSnapshot& keyframe, View view, int stretch);
  /// Takes over keyframes as they are, their tracks numbered anew.
  void append(std::vector<StoredKeyframe> keyframes);
  /// Later estimates of one that was entered.
  void update(std::size_t position, const KeyframeSnapshot& keyframe);
  /// Triangulates the tracks of a stretch by the present poses.
  void triangulate(int stretch);
  /// The same of the tracks that a keyframe sees, by it and those shortly before it.
  void triangulateAround(std::size_t keyframe);
  /// Brings a segment into the world and the unit of another one, of which it becomes a part.
  void move(int segment, int into, const Similarity& S_into_segment);
  /// Moves one keyframe within the world of its segment, its unit with it.
  void move(std::size_t keyframe, const Similarity& S_new_old);

  [[nodiscard]] const std::vector<StoredKeyframe>& keyframes() const { return keyframes_; }
  [[nodiscard]] std::vector<StoredKeyframe>& keyframes() { return keyframes_; }
  [[nodiscard]] const StoredKeyframe& operator[](std::size_t i) const { return keyframes_[i]; }
  [[nodiscard]] std::size_t size() const { return keyframes_.size(); }

  /// A keyframe and those before and after it in its stretch, the keyframe first.
  [[nodiscard]] std::vector<std::size_t> neighbourhood(std::size_t keyframe,
                                                       std::size_t reach) const;
  /// Points that these keyframes see, each once.
  [[nodiscard]] std::vector<StoredPoint> pointsOf(const std::vector<std::size_t>& keyframes) const;

  /// Positions of a segment's keyframes, in the order in which they came.
  [[nodiscard]] const std::vector<std::size_t>& inSegment(int segment) const {
    return segments_.at(segment);
  }
  /// Median of the known inverse depths of a keyframe; 0 without any [1/unit].
  [[nodiscard]] double medianInverseDepth(std::size_t keyframe) const;

  /// Triangulated tracks that two or more keyframes of these stretches see.
  /// @param first_stretch the first of them
  [[nodiscard]] std::vector<MapTrack> tracks(int first_stretch) const;
  /// Whether two keyframes have corners in common that were followed from one to the other.
  [[nodiscard]] bool shareTracks(std::size_t a, std::size_t b) const;

  /// Bytes that the keyframes take.
  [[nodiscard]] std::size_t bytes() const;

 private:
  void follow(StoredKeyframe& keyframe);
  void triangulateAll(const std::vector<std::size_t>& keyframes, const StoredKeyframe* only);

  std::vector<StoredKeyframe> keyframes_;
  std::map<int, std::vector<std::size_t>> segments_;
  std::map<int, std::vector<std::size_t>> stretches_;
  std::uint32_t next_track_ = 0;
};

}  // namespace dsorb::place
