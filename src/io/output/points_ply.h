// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/odometry/observer.h"

#include "io/output/map_changes.h"
#include "io/output/output_file.h"
#include "io/output/spool.h"

#include <cstdint>
#include <filesystem>
#include <map>
#include <vector>

namespace dsorb::io {

/// tracks.ply: corners that several keyframes see, as a binary little-endian PLY file with two
/// elements: `point` (x y z segment) and `observation` (point keyframe u v), the latter with the
/// position of the point in the former and of the keyframe's image in its sequence.
void writeTracks(const std::filesystem::path& path, const std::vector<MapTrack>& tracks);

/// points.ply: the map as binary little-endian vertices `x y z red green blue
/// inverse_depth_variance segment keyframe`, in world coordinates of each segment; the last is the
/// position of the host's image. Points of retired keyframes are final and wait in a file, not in
/// memory.
class PointsPly {
 public:
  explicit PointsPly(std::filesystem::path folder);

  void setKeyframe(const KeyframeSnapshot& keyframe);
  void retireKeyframe(const KeyframeSnapshot& keyframe);

  /// From the next update() on points are where joins and loops put them.
  void change(const MapChanges& changes);

  /// Replaces the file when points changed.
  void update();

 private:
  void copySpool(ReplacingFile& target) const;

  std::filesystem::path folder_;
  std::map<FrameId, KeyframeSnapshot> active_;
  NamelessFile spool_;
  std::uintmax_t spool_bytes_ = 0;
  MapChanges changes_;
  bool changed_ = true;
};

}  // namespace dsorb::io
