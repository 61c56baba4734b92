// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "io/input/image_source.h"

#include <filesystem>
#include <optional>
#include <string>
#include <vector>

namespace dsorb {

/// Time of one image, and where it is written.
struct TimeEntry {
  double timestamp = 0;    // [s]
  double exposure_ms = 0;  // 0: not given
  int line = 0;
};

/// Lines "id seconds [exposure in ms]" of DSO (the id is not used), "seconds", or "2011-09-26
/// 13:02:25.964" of KITTI's raw data (taken for UTC).
/// @throws IoError naming file and line
[[nodiscard]] std::vector<TimeEntry> readTimes(const std::filesystem::path& file);

/// Times that the names of images are, as TUM-RGBD, EuRoC and extractors of bags name them: one
/// number behind one prefix, increasing, such that as seconds, milliseconds, microseconds or
/// nanoseconds they are times of a camera. Not yet in seconds.
[[nodiscard]] std::optional<std::vector<TimeEntry>> timesInNames(const ImageSource& images);

/// Turns times that are no camera's in the unit that they should have into seconds, and says so; in
/// that unit they are turned into seconds otherwise. Gaps that no camera makes are told.
/// @param file that has them, for messages
/// @param nanoseconds whether they should be nanoseconds, and are divided already; else seconds
/// @param warnings one sentence each
void settleUnit(const std::filesystem::path& file,
                bool nanoseconds,
                std::vector<TimeEntry>& entries,
                std::vector<std::string>& warnings);

}  // namespace dsorb
