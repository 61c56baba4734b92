// SPDX-License-Identifier: BSD-3-Clause
#include "io/output/run_files.h"

#include "io/output/output_file.h"
#include "io/output/run_record.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace dsorb::io {
namespace {

constexpr std::size_t kPoseColumns = 7;  // translation and quaternion
constexpr int kCovarianceColumns = 21;   // upper triangle of 6 x 6

/// Text as RFC 4180 has it: in quotes where it holds a comma, a quote or a line break.
std::string csvField(const std::string& text) {
  if (text.find_first_of(",\"\r\n") == std::string::npos) return text;
  std::string field = "\"";
  for (const char c : text) field += c == '"' ? std::string("\"\"") : std::string(1, c);
  return field + "\"";
}

/// Translation and quaternion (x y z w).
std::array<double, kPoseColumns> numbersOf(const SE3& pose) {
  const Eigen::Vector3d& t = pose.translation();
  const Eigen::Quaterniond& q = pose.unitQuaternion();
  return {t.x(), t.y(), t.z(), q.x(), q.y(), q.z(), q.w()};
}

std::string poseFields(const std::optional<SE3>& pose) {
  if (!pose || !isFinite(*pose)) return std::string(kPoseColumns, ',');
  return fmt::format(",{:.9f}", fmt::join(numbersOf(*pose), ","));
}

std::string covarianceFields(const std::optional<Matrix6d>& covariance) {
  if (!covariance || !covariance->allFinite()) return std::string(kCovarianceColumns, ',');
  std::string fields;
  for (int row = 0; row < 6; ++row) {
    for (int column = row; column < 6; ++column) {
      fields += fmt::format(",{:.6e}", (*covariance)(row, column));
    }
  }
  return fields;
}

/// Calls f with every entry, sorted by time.
template <typename F>
void forEachByTime(const Entries& entries, F f) {
  std::vector<std::pair<double, std::size_t>> order;
  order.reserve(entries.size());
  for (std::size_t i = 0; i < entries.size(); ++i) order.emplace_back(entries.at(i).timestamp, i);
  std::sort(order.begin(), order.end());
  for (const auto& place : order) f(entries.at(place.second));
}

std::string lineOf(const PosedEntry& entry, const RunRecord& record) {
  return tumLine(entry.timestamp, record.T_world_cam(entry));
}

}  // namespace

std::string frameTableHeader() {
  std::string header =
      "index,timestamp,state,milliseconds,is_keyframe,tracking_rmse,segment,image,keyframe,rel_tx,"
      "rel_ty,rel_tz,rel_qx,rel_qy,rel_qz,rel_qw";
  for (const char* prefix : {"cov", "world_cov"}) {
    for (int row = 0; row < 6; ++row) {
      for (int column = row; column < 6; ++column) {
        header += fmt::format(",{}_{}{}", prefix, row, column);
      }
    }
  }
  return header + "\n";
}

std::string frameTableLine(const FrameEstimate& estimate,
                           double milliseconds,
                           const std::string& image_file) {
  const double rmse = estimate.tracking_rmse.value_or(-1);
  return fmt::format(
      "{},{:.9f},{},{:.3f},{},{},{},{},{}{}{}{}\n",
      estimate.frame->id().value,
      estimate.frame->timestamp(),
      name(estimate.state),
      milliseconds,
      estimate.is_keyframe ? 1 : 0,
      std::isfinite(rmse) && rmse >= 0 ? fmt::format("{:.4f}", static_cast<float>(rmse)) : "",
      estimate.segment,
      csvField(image_file),
      estimate.keyframe ? fmt::to_string(estimate.keyframe->value) : "",
      poseFields(estimate.T_cam_keyframe),
      covarianceFields(estimate.covariance),
      covarianceFields(estimate.world_covariance));
}

TrajectoryWriter::TrajectoryWriter(std::filesystem::path folder, std::string stem)
    : folder_(std::move(folder)), stem_(std::move(stem)), file_(path("")) {}

std::filesystem::path TrajectoryWriter::path(const std::string& suffix) const {
  return folder_ / (stem_ + suffix + ".txt");
}

void TrajectoryWriter::update(const RunRecord& record, const Entries& entries) {
  for (; written_ < entries.size(); ++written_) {
    const PosedEntry entry = entries.at(written_);
    if (entry.segment != segment_.value_or(entry.segment)) {
      file_ = GrowingFile(path(fmt::format("_{}", entry.segment)));
    }
    segment_ = entry.segment;
    file_.append(lineOf(entry, record));
  }
}

void TrajectoryWriter::finish(const RunRecord& record, const Entries& entries) const {
  writeTum(path(""), record, entries, record.longestSegment());
  const auto numbered = [&](int segment) { return path(fmt::format("_{}", segment)); };
  if (record.facts().segments.size() > 1) {
    for (const int segment : record.facts().segments) {
      writeTum(numbered(segment), record, entries, segment);
    }
  }
  std::error_code error;  // files of segments that are part of another one now
  for (const SegmentsJoined& joined : record.changes().joins) {
    std::filesystem::remove(numbered(joined.segment), error);
  }
}

std::string tumLine(double timestamp, const SE3& T_world_cam) {
  auto numbers = numbersOf(T_world_cam);
  if (numbers.back() < 0) {
    for (std::size_t i = 3; i < numbers.size(); ++i) numbers[i] = -numbers[i];
  }
  return fmt::format("{:.9f} {:.9f}\n", timestamp, fmt::join(numbers, " "));
}

void writeTum(const std::filesystem::path& path,
              const RunRecord& record,
              const Entries& entries,
              int segment) {
  ReplacingFile file(path);
  forEachByTime(entries, [&](const PosedEntry& entry) {
    if (record.segmentOf(entry) == segment) file.append(lineOf(entry, record));
  });
  file.commit();
}

void writeKitti(const std::filesystem::path& path,
                const RunRecord& record,
                const Entries& entries) {
  ReplacingFile file(path);
  forEachByTime(entries, [&](const PosedEntry& entry) {
    const Eigen::Matrix<double, 3, 4, Eigen::RowMajor> T =
        record.T_world_cam(entry).matrix().topRows<3>();
    file.append(fmt::format("{:.9e}\n", fmt::join(T.data(), T.data() + T.size(), " ")));
  });
  file.commit();
}

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
constexpr std::size_t kBlockVertices = 4096;

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

/// Head of points.ply; its length is the same for any count.
std::string header(std::uintmax_t count) {
  const std::string number = fmt::format("{}", count);
  return fmt::format(
      "ply\nformat binary_little_endian 1.0\ncomment unit of each segment: units in "
      "run.json{:{}}\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n"
      "property uchar red\nproperty uchar green\nproperty uchar blue\n"
      "property float inverse_depth_variance\nproperty int segment\nproperty int "
      "keyframe\nend_header\n",
      "",
      20 - number.size(),
      number);
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
  const std::string head = fmt::format(
      "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty float "
      "y\n"
      "property float z\nproperty int segment\nelement observation {}\nproperty int point\n"
      "property int keyframe\nproperty float u\nproperty float v\nend_header\n",
      tracks.size(),
      count);
  replaceFile(path, head + points + sights);
}

PointsPly::PointsPly(const std::filesystem::path& folder) : file_(folder / "points.ply") {
  update();
}

void PointsPly::retireKeyframe(const KeyframeSnapshot& keyframe) {
  active_.erase(keyframe.id);
  retired_ += vertices(keyframe);
}

void PointsPly::update() {
  const std::size_t begin = header(0).size();
  std::string body = retired_;
  for (const auto& [id, keyframe] : active_) body += vertices(keyframe);
  try {
    file_.write(begin + final_bytes_, body);
  } catch (const IoError&) {
    file_.cut(begin + bytes_);  // as many points as the header counts, older or newer ones
    throw;
  }
  bytes_ = final_bytes_ + body.size();
  file_.write(0, header(bytes_ / kVertexBytes));
  file_.cut(begin + bytes_);
  final_bytes_ += retired_.size();
  retired_.clear();
}

void PointsPly::finish(const MapChanges& changes) {
  update();
  const std::size_t begin = header(0).size();
  for (std::uintmax_t done = 0; done < bytes_ && !changes.empty();) {
    const auto size = std::min<std::uintmax_t>(bytes_ - done, kBlockVertices * kVertexBytes);
    const std::string told = file_.read(begin + done, static_cast<std::size_t>(size));
    file_.write(begin + done, changed(told, changes));
    done += size;
  }
}

}  // namespace dsorb::io
