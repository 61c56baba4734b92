// SPDX-License-Identifier: BSD-3-Clause
#include "io/output/trajectory_writer.h"

#include "io/output/run_record.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
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

constexpr std::size_t kBlockBytes = 1 << 16;

/// Calls f with every entry, sorted by time.
template <typename F>
void forEachByTime(const Entries& entries, F f) {
  std::vector<std::pair<double, std::size_t>> order;
  order.reserve(entries.size());
  for (std::size_t i = 0; i < entries.size(); ++i) order.emplace_back(entries.at(i).timestamp, i);
  std::sort(order.begin(), order.end());
  for (const auto& place : order) f(entries.at(place.second));
}

/// A file that takes the place of an earlier one, written line by line.
class LineFile {
 public:
  explicit LineFile(const std::filesystem::path& path) : file_(path) {}
  void add(const std::string& line) {
    lines_ += line;
    if (lines_.size() < kBlockBytes) return;
    file_.append(lines_);
    lines_.clear();
  }
  void commit() {
    file_.append(lines_);
    file_.commit();
  }

 private:
  ReplacingFile file_;
  std::string lines_;
};

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
  std::string lines;
  const auto flush = [&] {
    if (!lines.empty()) file_.append(lines);
    lines.clear();
  };
  for (; written_ < entries.size(); ++written_) {
    const PosedEntry entry = entries.at(written_);
    if (entry.segment != segment_.value_or(entry.segment)) {
      flush();
      file_ = GrowingFile(path(fmt::format("_{}", entry.segment)));
    }
    segment_ = entry.segment;
    lines += lineOf(entry, record);
  }
  flush();
}

void TrajectoryWriter::finish(const RunRecord& record, const Entries& entries) const {
  writeTum(path(""), record, entries, record.longestSegment());
  const auto numbered = [&](int segment) { return path(fmt::format("_{}", segment)); };
  if (record.segments().size() > 1) {
    for (const int segment : record.segments()) {
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
  LineFile file(path);
  forEachByTime(entries, [&](const PosedEntry& entry) {
    if (record.segmentOf(entry) == segment) file.add(lineOf(entry, record));
  });
  file.commit();
}

void writeKitti(const std::filesystem::path& path,
                const RunRecord& record,
                const Entries& entries) {
  LineFile file(path);
  forEachByTime(entries, [&](const PosedEntry& entry) {
    const Eigen::Matrix<double, 3, 4, Eigen::RowMajor> T =
        record.T_world_cam(entry).matrix().topRows<3>();
    file.add(fmt::format("{:.9e}\n", fmt::join(T.data(), T.data() + T.size(), " ")));
  });
  file.commit();
}

}  // namespace dsorb::io
