// SPDX-License-Identifier: BSD-3-Clause
#include "app/dataset_writer.h"

#include "dsorb/error.h"

#include "base/parallel.h"
#include "io/output/figures.h"
#include "io/output/output_file.h"

#include <fmt/format.h>
#include <opencv2/core.hpp>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <string>
#include <system_error>

namespace dsorb::app {
namespace {

namespace fs = std::filesystem;
using synthetic::SyntheticFrame;
using synthetic::SyntheticSequence;

constexpr std::size_t kFramesAtOnce = 8;  // memory stays bounded, order stays nearly that of time
constexpr double kMillimetres = 1e3;      // per metre

/// Makes the folder and removes the numbered PNGs of an earlier data set from it.
void prepareImageFolder(const fs::path& folder) {
  fs::create_directories(folder);
  for (const fs::directory_entry& entry : fs::directory_iterator(folder)) {
    const std::string name = entry.path().stem().string();
    const bool numbered = !name.empty() && name.find_first_not_of("0123456789") == name.npos;
    if (numbered && entry.path().extension() == ".png") fs::remove(entry.path());
  }
}

cv::Mat depthInMillimetres(const SyntheticFrame& frame) {
  cv::Mat depth(frame.height, frame.width, CV_16U);
  auto* pixel = depth.ptr<std::uint16_t>();
  for (const float inverse : frame.inverse_depth) {
    const double millimetres = inverse > 0 ? std::round(kMillimetres / inverse) : 0.0;
    constexpr double kLargest = std::numeric_limits<std::uint16_t>::max();
    *pixel++ = millimetres <= kLargest ? static_cast<std::uint16_t>(millimetres) : std::uint16_t{0};
  }
  return depth;
}

void writeCalibration(const SyntheticSequence& sequence, const fs::path& folder) {
  const PinholeCamera& camera = sequence.camera();
  const std::string size = fmt::format("{} {}\n", camera.width, camera.height);
  const std::string numbers =
      fmt::format("{:.12g} {:.12g} {:.12g} {:.12g}", camera.fx, camera.fy, camera.cx, camera.cy);
  io::replaceFile(folder / "camera.txt", "Pinhole " + numbers + " 0\n" + size + "none\n" + size);
  fs::remove(folder / "pcalib.txt");
  fs::remove(folder / "vignette.png");
  if (!sequence.isPhotometric()) return;
  std::string response;
  for (const double value : sequence.inverseResponse()) response += fmt::format("{:.9f} ", value);
  response.back() = '\n';
  io::replaceFile(folder / "pcalib.txt", response);
  cv::Mat vignette(camera.height, camera.width, CV_16U);
  auto* pixel = vignette.ptr<std::uint16_t>();
  for (const float share : sequence.vignette()) {
    *pixel++ = static_cast<std::uint16_t>(std::lround(65535.0F * share));
  }
  io::writePng(folder / "vignette.png", vignette);
}

/// The list beside a data set, of those that were written there.
struct DatasetList {
  fs::path file;
  std::string name;  // of the data set
  io::Json sequences = io::Json::object();
};

DatasetList listBeside(const fs::path& dataset) {
  const fs::path folder = fs::absolute(dataset / "").lexically_normal().parent_path();
  DatasetList list{folder.parent_path() / "sequences.json", folder.filename().string()};
  if (!fs::exists(list.file)) return list;
  std::ifstream stream(list.file);
  list.sequences = io::Json::parse(stream, nullptr, false);
  if (!list.sequences.is_object()) {
    throw IoError(fmt::format("{}: expected a JSON object of sequences", list.file.string()));
  }
  return list;
}

/// @throws IoError where files of others would be replaced
void refuseForeign(const fs::path& folder) {
  const DatasetList list = listBeside(folder);
  if (list.sequences.contains(list.name) || !fs::exists(folder) || fs::is_empty(folder)) return;
  throw IoError(
      fmt::format("{}: holds files that are not of a data set written before ({} does not "
                  "list it); choose another folder or empty it",
                  folder.string(),
                  list.file.string()));
}

/// Adds or replaces the entry of a data set in the list beside it.
void listInParent(const SyntheticSequence& sequence, const fs::path& folder) {
  DatasetList list = listBeside(folder);
  io::Json entry = {{"path", list.name}, {"frames", sequence.length()}};
  if (!sequence.hasParallax()) entry["no_start"] = true;
  list.sequences[list.name] = entry;
  io::replaceFile(list.file,
                  list.sequences.dump(1, ' ', false, io::Json::error_handler_t::replace) + "\n");
}

/// Rows of times.txt and groundtruth.txt.
struct FrameRows {
  std::string time;
  std::string truth;
};

FrameRows writeFrame(const SyntheticSequence& sequence, const fs::path& folder, int index) {
  const std::string name = fmt::format("{:05d}", index);
  SyntheticFrame frame = sequence.frame(index);
  io::writePng(folder / "images" / (name + ".png"),
               cv::Mat(frame.height, frame.width, CV_8U, frame.image.data()));
  io::writePng(folder / "depth" / (name + ".png"), depthInMillimetres(frame));
  return {fmt::format("{} {:.9f} {:.6f}\n", name, frame.timestamp, 1e3 * frame.exposure),
          io::tumLine(frame.timestamp, frame.T_world_cam)};
}

std::vector<FrameRows> writeFrames(const SyntheticSequence& sequence,
                                   const fs::path& folder,
                                   int num_threads,
                                   const std::function<void(int)>& progress) {
  std::vector<FrameRows> rows(static_cast<std::size_t>(sequence.length()));
  TaskArena arena(num_threads);
  for (std::size_t first = 0; first < rows.size(); first += kFramesAtOnce) {
    const std::size_t count = std::min(kFramesAtOnce, rows.size() - first);
    arena.run([&] {
      forEachRange(count, 1, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = first + begin; i < first + end; ++i) {
          rows[i] = writeFrame(sequence, folder, static_cast<int>(i));
        }
      });
    });
    if (progress) progress(static_cast<int>(first + count));
  }
  return rows;
}

}  // namespace

void writeDataset(const SyntheticSequence& sequence,
                  const fs::path& folder,
                  int num_threads,
                  const std::function<void(int)>& progress) try {
  refuseForeign(folder);
  prepareImageFolder(folder / "images");
  prepareImageFolder(folder / "depth");
  writeCalibration(sequence, folder);
  std::string times;
  std::string truth = "# timestamp tx ty tz qx qy qz qw (camera to world)\n";
  for (const FrameRows& row : writeFrames(sequence, folder, num_threads, progress)) {
    times += row.time;
    truth += row.truth;
  }
  io::replaceFile(folder / "times.txt", times);
  io::replaceFile(folder / "groundtruth.txt", truth);
  listInParent(sequence, folder);
} catch (const fs::filesystem_error& error) {
  throw IoError(error.what());
}

}  // namespace dsorb::app
