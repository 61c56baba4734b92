// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/odometry/observer.h"

#include "io/output/output_file.h"
#include "io/output/run_record.h"

#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace dsorb::io {

/// First line of frames.csv.
[[nodiscard]] std::string frameTableHeader();

/// Line of a frame; what does not exist or is not finite is an empty field.
[[nodiscard]] std::string frameTableLine(const FrameEstimate& estimate,
                                         double milliseconds,
                                         const std::string& image_file);

/// trajectory.txt or keyframes.txt: grows with the estimates of the moment, ends as the final poses
/// sorted by time. A file holds one segment: while the run goes on the first one, those after it
/// in trajectory_<number>.txt; at the end the longest one, and where there are several each of them
/// also under its number.
class TrajectoryWriter {
 public:
  /// @param stem "trajectory" or "keyframes"
  TrajectoryWriter(std::filesystem::path folder, std::string stem);

  /// Appends the entries that are new. @throws IoError
  void update(const RunRecord& record, const Entries& entries);
  void finish(const RunRecord& record, const Entries& entries) const;

 private:
  [[nodiscard]] std::filesystem::path path(const std::string& suffix) const;

  std::filesystem::path folder_;
  std::string stem_;
  GrowingFile file_;
  std::optional<int> segment_;  // that the file holds
  std::size_t written_ = 0;
};

/// A line `timestamp tx ty tz qx qy qz qw`, nine decimals, qw not negative.
/// @source TUM RGB-D benchmark, file formats
[[nodiscard]] std::string tumLine(double timestamp, const SE3& T_world_cam);

/// Replaces a file by the lines of a segment's entries, sorted by time.
void writeTum(const std::filesystem::path& path,
              const RunRecord& record,
              const Entries& entries,
              int segment);

/// All entries, of one segment, as lines of a 3x4 matrix, row by row: line n belongs to line n of
/// the above.
/// @source KITTI odometry benchmark, format of poses
void writeKitti(const std::filesystem::path& path, const RunRecord& record, const Entries& entries);

/// tracks.ply: corners that several keyframes see, as a binary little-endian PLY file with two
/// elements: `point` (x y z segment) and `observation` (point keyframe u v), the latter with the
/// position of the point in the former and of the keyframe's image in its sequence.
void writeTracks(const std::filesystem::path& path, const std::vector<MapTrack>& tracks);

/// points.ply: the map as binary little-endian vertices `x y z red green blue
/// inverse_depth_variance segment keyframe`, in world coordinates of each segment; the last is the
/// position of the host's image. Points of retired keyframes are final, those of the others stand
/// behind them for now.
class PointsPly {
 public:
  explicit PointsPly(const std::filesystem::path& folder);

  void setKeyframe(const KeyframeSnapshot& keyframe) { active_[keyframe.id] = keyframe; }
  void retireKeyframe(const KeyframeSnapshot& keyframe);

  /// Whether as many points wait for update() as should be kept in memory.
  [[nodiscard]] bool isFull() const { return retired_.size() > kMostWaiting; }
  /// Brings the file up to date.
  void update();
  /// The same for the last time: points are where joins and loops put them.
  void finish(const MapChanges& changes);

 private:
  static constexpr std::size_t kMostWaiting = 1 << 18;  // [bytes]

  std::map<FrameId, KeyframeSnapshot> active_;
  GrowingFile file_;
  std::string retired_;             // since the last update
  std::uintmax_t final_bytes_ = 0;  // of the vertices of retired keyframes in the file
  std::uintmax_t bytes_ = 0;        // of all vertices in the file
};

}  // namespace dsorb::io
