// SPDX-License-Identifier: BSD-3-Clause
#include "io/output/tracks_ply.h"

#include "io/output/little_endian.h"
#include "io/output/output_file.h"

#include <fmt/format.h>

#include <cstddef>
#include <cstdint>
#include <string>

namespace dsorb::io {

void writeTracks(const std::filesystem::path& path, const std::vector<MapTrack>& tracks) {
  std::string points;
  std::string sights;
  std::size_t count = 0;
  for (std::size_t i = 0; i < tracks.size(); ++i) {
    for (const float coordinate : tracks[i].position.cast<float>().eval()) {
      appendLittleEndian(coordinate, points);
    }
    appendLittleEndian(static_cast<std::int32_t>(tracks[i].segment), points);
    for (const TrackSight& sight : tracks[i].sights) {
      appendLittleEndian(static_cast<std::int32_t>(i), sights);
      appendLittleEndian(static_cast<std::int32_t>(sight.keyframe.value), sights);
      appendLittleEndian(sight.pixel.x(), sights);
      appendLittleEndian(sight.pixel.y(), sights);
      ++count;
    }
  }
  ReplacingFile file(path);
  file.append(fmt::format(
      "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float "
      "y\n"
      "property float z\nproperty int segment\nelement observation {}\nproperty int point\n"
      "property int keyframe\nproperty float u\nproperty float v\nend_header\n",
      tracks.size(),
      count));
  file.append(points);
  file.append(sights);
  file.commit();
}

}  // namespace dsorb::io
