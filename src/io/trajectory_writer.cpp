// SPDX-License-Identifier: BSD-3-Clause
#include "io/trajectory_writer.h"

#include <fmt/format.h>

#include <algorithm>
#include <iterator>
#include <utility>

namespace dsorb::io {
namespace {

std::vector<PosedEntry> sortedByTime(std::vector<PosedEntry> entries) {
  std::stable_sort(entries.begin(), entries.end(), [](const PosedEntry& l, const PosedEntry& r) {
    return l.timestamp < r.timestamp;
  });
  return entries;
}

}  // namespace

TrajectoryWriter::TrajectoryWriter(std::filesystem::path folder, std::string stem)
    : folder_(std::move(folder)), stem_(std::move(stem)) {
  file_.emplace(path(""));
}

std::filesystem::path TrajectoryWriter::path(const std::string& suffix) const {
  return folder_ / (stem_ + suffix + ".txt");
}

void TrajectoryWriter::update(const RunRecord& record, const std::vector<PosedEntry>& entries) {
  if (record.rollbacks() != rollbacks_) {  // lines were taken back: write the rest anew
    rollbacks_ = record.rollbacks();
    written_ = 0;
    file_.emplace(path(""));
  }
  std::string lines;
  for (; written_ < entries.size(); ++written_) {
    const PosedEntry& entry = entries[written_];
    lines += tumLine(entry.timestamp, record.T_world_cam(entry));
  }
  if (!lines.empty()) file_->append(lines);
}

void TrajectoryWriter::finish(const RunRecord& record, const std::vector<PosedEntry>& entries) {
  replaceFile(path(""), tumTrajectory(record, entries));
  if (record.segments().size() < 2) return;
  for (const int segment : record.segments()) {
    replaceFile(path(fmt::format("_{}", segment)), tumTrajectory(record, entries, segment));
  }
}

std::string tumLine(double timestamp, const SE3& T_world_cam) {
  const Eigen::Vector3d& t = T_world_cam.translation();
  Eigen::Vector4d q = T_world_cam.unitQuaternion().coeffs();  // x y z w
  if (q.w() < 0) q = -q;
  return fmt::format("{:.9f} {:.9f} {:.9f} {:.9f} {:.9f} {:.9f} {:.9f} {:.9f}\n",
                     timestamp,
                     t.x(),
                     t.y(),
                     t.z(),
                     q.x(),
                     q.y(),
                     q.z(),
                     q.w());
}

std::string tumTrajectory(const RunRecord& record,
                          const std::vector<PosedEntry>& entries,
                          std::optional<int> segment) {
  std::string text;
  for (const PosedEntry& entry : sortedByTime(entries)) {
    if (!segment || entry.segment == *segment)
      text += tumLine(entry.timestamp, record.T_world_cam(entry));
  }
  return text;
}

std::string kittiTrajectory(const RunRecord& record, const std::vector<PosedEntry>& entries) {
  std::string text;
  for (const PosedEntry& entry : sortedByTime(entries)) {
    const Eigen::Matrix<double, 3, 4, Eigen::RowMajor> T =
        record.T_world_cam(entry).matrix().topRows<3>();
    fmt::format_to(
        std::back_inserter(text), "{:.9e}\n", fmt::join(T.data(), T.data() + T.size(), " "));
  }
  return text;
}

}  // namespace dsorb::io
