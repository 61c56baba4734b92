// SPDX-License-Identifier: BSD-3-Clause
#include "io/output/points_ply.h"

#include "io/output/output_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace dsorb::io {
namespace {

/// Appends a number of four bytes.
template <typename Value>
void appendLittleEndian(Value value, std::string& bytes) {
  std::uint32_t bits = 0;
  static_assert(sizeof(Value) == sizeof(bits));
  std::memcpy(&bits, &value, sizeof(bits));
  for (int shift = 0; shift < 32; shift += 8) {
    bytes.push_back(static_cast<char>((bits >> shift) & 0xFFU));
  }
}

/// Reads a number of four bytes.
template <typename Value>
[[nodiscard]] Value littleEndian(const char* bytes) {
  std::uint32_t bits = 0;
  static_assert(sizeof(Value) == sizeof(bits));
  for (unsigned i = 0; i < sizeof(bits); ++i) {
    bits |= static_cast<std::uint32_t>(static_cast<unsigned char>(bytes[i])) << (8 * i);
  }
  Value value;
  std::memcpy(&value, &bits, sizeof(bits));
  return value;
}

constexpr std::uintmax_t kVertexBytes = 4 * sizeof(float) + 3 + 2 * sizeof(std::int32_t);
constexpr std::size_t kCopyVertices = 4096;

/// Vertices where joins and loops put them.
std::string changed(std::string_view vertices, const MapChanges& changes) {
  std::string bytes;
  constexpr std::size_t kVariance = 3 * sizeof(float) + 3;
  for (std::size_t at = 0; at < vertices.size(); at += kVertexBytes) {
    const char* const vertex = vertices.data() + at;
    const auto number = [&](std::size_t i) { return littleEndian<float>(vertex + i); };
    const auto segment = littleEndian<std::int32_t>(vertex + kVariance + 4);
    const auto keyframe = littleEndian<std::int32_t>(vertex + kVariance + 8);
    const Similarity change = changes.changeOf(segment, FrameId{keyframe});
    const Eigen::Vector3f told(number(0), number(4), number(8));
    const Eigen::Vector3f place = (change * told.cast<double>()).cast<float>();
    for (const float coordinate : place) appendLittleEndian(coordinate, bytes);
    bytes.append(vertex + 3 * sizeof(float), 3);
    const auto scale = static_cast<float>(change.scale);
    appendLittleEndian(number(kVariance) / (scale * scale), bytes);
    appendLittleEndian(static_cast<std::int32_t>(changes.segmentOf(segment)), bytes);
    appendLittleEndian(keyframe, bytes);
  }
  return bytes;
}

/// Vertices of all points that have a finite place in front of the camera.
std::string vertices(const KeyframeSnapshot& keyframe) {
  std::string bytes;
  for (const MapPoint& point : keyframe.points) {
    if (!(point.inverse_depth > 0) || !std::isfinite(point.variance)) continue;
    const Eigen::Vector3d p_cam = keyframe.camera.unproject(point.pixel.cast<double>()) /
                                  static_cast<double>(point.inverse_depth);
    const Eigen::Vector3f p_world = (keyframe.T_world_cam * p_cam).cast<float>();
    if (!p_world.allFinite()) continue;
    for (const float coordinate : p_world) appendLittleEndian(coordinate, bytes);
    const float grey = std::isfinite(point.intensity) ? point.intensity : 0.0F;
    const auto level =
        static_cast<char>(static_cast<unsigned char>(std::lround(std::clamp(grey, 0.0F, 255.0F))));
    bytes.append(3, level);
    appendLittleEndian(point.variance, bytes);
    appendLittleEndian(static_cast<std::int32_t>(keyframe.segment), bytes);
    appendLittleEndian(static_cast<std::int32_t>(keyframe.id.value), bytes);
  }
  return bytes;
}

std::string header(std::uintmax_t count) {
  return fmt::format(
      "ply\nformat binary_little_endian 1.0\ncomment unit of each segment: units in "
      "run.json\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\n"
      "property float inverse_depth_variance\nproperty int segment\nproperty int "
      "keyframe\nend_header\n",
      count);
}

}  // namespace

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

PointsPly::PointsPly(std::filesystem::path folder) : folder_(std::move(folder)), spool_(folder_) {
  update();
}

void PointsPly::setKeyframe(const KeyframeSnapshot& keyframe) {
  active_[keyframe.id] = keyframe;
  changed_ = true;
}

void PointsPly::retireKeyframe(const KeyframeSnapshot& keyframe) {
  active_.erase(keyframe.id);
  const std::string bytes = vertices(keyframe);
  spool_.write(spool_bytes_, bytes.data(), bytes.size());
  spool_bytes_ += bytes.size();
  changed_ = true;
}

void PointsPly::change(const MapChanges& changes) {
  changes_ = changes;
  changed_ = true;
}

void PointsPly::copySpool(ReplacingFile& target) const {
  std::vector<char> block(kCopyVertices * kVertexBytes);
  for (std::uintmax_t done = 0; done < spool_bytes_;) {
    const auto size =
        static_cast<std::size_t>(std::min<std::uintmax_t>(spool_bytes_ - done, block.size()));
    spool_.read(done, block.data(), size);
    const std::string_view told(block.data(), size);
    target.append(changes_.empty() ? told : std::string_view(changed(told, changes_)));
    done += size;
  }
}

void PointsPly::update() {
  if (!changed_) return;
  std::string body;
  for (const auto& [id, keyframe] : active_) body += vertices(keyframe);
  if (!changes_.empty()) body = changed(body, changes_);
  ReplacingFile file(folder_ / "points.ply");
  file.append(header((spool_bytes_ + body.size()) / kVertexBytes));
  if (spool_bytes_ > 0) copySpool(file);
  file.append(body);
  file.commit();
  changed_ = false;
}

}  // namespace dsorb::io
