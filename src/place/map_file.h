// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "place/keyframe_store.h"

#include <string>
#include <vector>

namespace dsorb::place {

/// Writes keyframes into an SQLite database, whose tables cameras, images, keypoints and
/// descriptors are those of COLMAP's database; docs/formats.md, "Maps". A file that is there is
/// replaced as a whole, where it is a map.
/// @source COLMAP, database format, https://colmap.github.io/database.html
/// @throws IoError naming the file
void writeMap(const std::string& path, const std::vector<StoredKeyframe>& keyframes);

/// @throws IoError naming the file and what is wrong: not a map, another version, damaged
[[nodiscard]] std::vector<StoredKeyframe> readMap(const std::string& path);

}  // namespace dsorb::place
