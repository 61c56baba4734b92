// SPDX-License-Identifier: BSD-3-Clause
#include "io/output/dataset_writer.h"

#include "dsorb/error.h"

#include "base/parallel.h"
#include "io/output/figures.h"
#include "io/output/output_file.h"
#include "io/output/run_files.h"

#include <fmt/format.h>
#include <nlohmann/json.hpp>
#include <opencv2/core.hpp>

#include <algorithm>
#include <cmath>
#include <fstream>
#include <limits>
#include <string>
#include <system_error>

namespace dsorb {
namespace {

namespace fs = std::filesystem;

constexpr int kFramesAtOnce = 8;      // memory stays bounded, order stays nearly that of time
constexpr double kMillimetres = 1e3;  // per metre

/// Makes the folder and removes the numbered PNGs of an earlier data set from it.
void prepareImageFolder(const fs::path& folder) {
  fs::create_directories(folder);
  for (const fs::directory_entry& entry : fs::directory_iterator(folder)) {
    const std::string name = entry.path().stem().string();
    const bool numbered = !name.empty() && name.find_first_not_of("0123456789") == name.npos;
    if (numbered && entry.path().extension() == ".png") fs::remove(entry.path());
  }
}

cv::Mat depthInMillimetres(const std::vector<float>& inverse_depth, const PinholeCamera& camera) {
  cv::Mat depth(camera.height, camera.width, CV_16U);
  auto* pixel = depth.ptr<std::uint16_t>();
  for (const float inverse : inverse_depth) {
    const double millimetres = inverse > 0 ? std::round(kMillimetres / inverse) : 0.0;
    constexpr double kLargest = std::numeric_limits<std::uint16_t>::max();
    *pixel++ = millimetres <= kLargest ? static_cast<std::uint16_t>(millimetres) : std::uint16_t{0};
  }
  return depth;
}

void writeCalibration(const DatasetDescription& description) {
  const PinholeCamera& camera = description.camera;
  const std::string size = fmt::format("{} {}\n", camera.width, camera.height);
  io::replaceFile(description.folder / "camera.txt",
                  fmt::format("Pinhole {:.12g} {:.12g} {:.12g} {:.12g} 0\n{}none\n{}",
                              camera.fx,
                              camera.fy,
                              camera.cx,
                              camera.cy,
                              size,
                              size));
  fs::remove(description.folder / "pcalib.txt");
  fs::remove(description.folder / "vignette.png");
  if (description.inverse_response.empty()) return;
  std::string response;
  for (const double value : description.inverse_response) {
    response += fmt::format("{:.9f} ", value);
  }
  response.back() = '\n';
  io::replaceFile(description.folder / "pcalib.txt", response);
  cv::Mat vignette(camera.height, camera.width, CV_16U, cv::Scalar(65535));
  auto* pixel = vignette.ptr<std::uint16_t>();
  for (const float share : description.vignette) {
    *pixel++ = static_cast<std::uint16_t>(std::lround(65535.0F * share));
  }
  io::writePng(description.folder / "vignette.png", vignette);
}

/// The list beside a data set, of those that were written there.
struct DatasetList {
  fs::path file;
  std::string name;  // of the data set
  nlohmann::ordered_json sequences = nlohmann::ordered_json::object();
};

DatasetList listBeside(const fs::path& dataset) {
  const fs::path folder = fs::absolute(dataset / "").lexically_normal().parent_path();
  DatasetList list{folder.parent_path() / "sequences.json", folder.filename().string()};
  if (!fs::exists(list.file)) return list;
  std::ifstream stream(list.file);
  list.sequences = nlohmann::ordered_json::parse(stream, nullptr, false);
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
void listInParent(const DatasetDescription& description) {
  DatasetList list = listBeside(description.folder);
  nlohmann::ordered_json entry = {{"path", list.name}, {"frames", description.frames}};
  if (!description.can_start) entry["no_start"] = true;
  list.sequences[list.name] = entry;
  io::replaceFile(
      list.file,
      list.sequences.dump(1, ' ', false, nlohmann::json::error_handler_t::replace) + "\n");
}

/// Rows of times.txt and groundtruth.txt.
struct FrameRows {
  std::string time;
  std::string truth;
};

FrameRows writeFrame(const DatasetDescription& description, int index, DatasetFrame frame) {
  const std::string name = fmt::format("{:05d}", index);
  const PinholeCamera& camera = description.camera;
  io::writePng(description.folder / "images" / (name + ".png"),
               cv::Mat(camera.height, camera.width, CV_8U, frame.image.data()));
  io::writePng(description.folder / "depth" / (name + ".png"),
               depthInMillimetres(frame.inverse_depth, camera));
  return {fmt::format("{} {:.9f} {:.6f}\n", name, frame.timestamp, 1e3 * frame.exposure),
          io::tumLine(frame.timestamp, frame.T_world_cam)};
}

std::vector<FrameRows> writeFrames(const DatasetDescription& description,
                                   const std::function<DatasetFrame(int)>& make,
                                   const std::function<void(int)>& progress) {
  std::vector<FrameRows> rows(static_cast<std::size_t>(description.frames));
  TaskArena arena(description.num_threads);
  for (int first = 0; first < description.frames; first += kFramesAtOnce) {
    const int count = std::min(kFramesAtOnce, description.frames - first);
    arena.run([&] {
      forEachRange(static_cast<std::size_t>(count), 1, [&](std::size_t begin, std::size_t end) {
        for (std::size_t i = begin; i < end; ++i) {
          const int index = first + static_cast<int>(i);
          rows[static_cast<std::size_t>(index)] = writeFrame(description, index, make(index));
        }
      });
    });
    if (progress) progress(first + count);
  }
  return rows;
}

}  // namespace

void writeDataset(const DatasetDescription& description,
                  const std::function<DatasetFrame(int)>& make,
                  const std::function<void(int)>& progress) try {
  refuseForeign(description.folder);
  prepareImageFolder(description.folder / "images");
  prepareImageFolder(description.folder / "depth");
  writeCalibration(description);
  std::string times;
  std::string truth = "# timestamp tx ty tz qx qy qz qw (camera to world)\n";
  for (const FrameRows& row : writeFrames(description, make, progress)) {
    times += row.time;
    truth += row.truth;
  }
  io::replaceFile(description.folder / "times.txt", times);
  io::replaceFile(description.folder / "groundtruth.txt", truth);
  listInParent(description);
} catch (const fs::filesystem_error& error) {
  throw IoError(error.what());
}

}  // namespace dsorb
