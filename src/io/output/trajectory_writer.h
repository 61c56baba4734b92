// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/odometry/observer.h"

#include "io/output/output_file.h"
#include "io/output/run_record.h"

#include <cstddef>
#include <filesystem>
#include <optional>
#include <string>

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

}  // namespace dsorb::io
