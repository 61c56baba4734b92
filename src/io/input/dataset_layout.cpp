// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/error.h"

#include "io/input/dataset.h"
#include "io/input/image_decoder.h"
#include "io/input/image_store.h"
#include "io/input/video.h"

#include <fmt/format.h>

#include <array>
#include <optional>
#include <string>
#include <string_view>

namespace dsorb {
namespace {

namespace fs = std::filesystem;

/// The file when it exists, else an empty path. What else has its name, a folder or a broken link,
/// is left to those who read it: they complain.
fs::path existing(const fs::path& file) {
  return fs::symlink_status(file).type() == fs::file_type::not_found ? fs::path() : file;
}

/// The folder when it exists, else an empty path.
fs::path existingFolder(const fs::path& folder) {
  return fs::is_directory(folder) ? folder : fs::path();
}

/// Files that lie beside the images in the layouts of DSO, TUM-mono and plain folders.
DatasetLayout beside(SequenceFormat format, const fs::path& images, const fs::path& base) {
  DatasetLayout layout;
  layout.format = format;
  layout.images = images;
  layout.times = existing(base / "times.txt");
  layout.calibration = existing(base / "camera.txt");
  layout.response = existing(base / "pcalib.txt");
  layout.vignette = existing(base / "vignette.png");
  layout.masks = existingFolder(base / "masks");
  return layout;
}

std::optional<DatasetLayout> findDso(const fs::path& path) {
  if (fs::is_regular_file(path) && lowerSuffix(path) == ".zip") {
    return beside(SequenceFormat::kDso, path, path.parent_path());
  }
  if (fs::is_directory(path / "images")) return beside(SequenceFormat::kDso, path / "images", path);
  if (fs::is_regular_file(path / "images.zip")) {
    return beside(SequenceFormat::kDso, path / "images.zip", path);
  }
  const bool image_folder = fs::is_directory(path) && holdsImages(path);
  if (image_folder && fs::is_regular_file(path.parent_path() / "camera.txt")) {
    return beside(SequenceFormat::kDso, path, path.parent_path());
  }
  return std::nullopt;
}

/// Number N of a folder image_N, or image_0N of raw data; empty for other names.
std::optional<int> kittiCamera(const fs::path& folder) {
  const std::string name = folder.filename().string();
  for (const std::string_view prefix : {"image_0", "image_"}) {
    if (name.size() != prefix.size() + 1 || name.compare(0, prefix.size(), prefix) != 0) continue;
    const int camera = name.back() - '0';
    if (camera >= 0 && camera <= 3) return camera;
  }
  return std::nullopt;
}

/// The one drive below the folder of a day of KITTI's raw data.
fs::path onlyDrive(const fs::path& day) {
  fs::path drive;
  if (!fs::is_regular_file(day / "calib_cam_to_cam.txt")) return drive;
  for (const fs::directory_entry& entry : fs::directory_iterator(day)) {
    if (!entry.is_directory() || entry.path().string().find("_drive_") == std::string::npos)
      continue;
    if (!drive.empty()) {
      throw IoError(fmt::format("{}: several drives, as {} and {}; name one",
                                day.string(),
                                drive.filename().string(),
                                entry.path().filename().string()));
    }
    drive = entry.path();
  }
  return drive;
}

/// The folder image_N that is meant by a path; empty where there is none.
fs::path kittiFolder(const fs::path& path) {
  if (kittiCamera(path)) return path;
  if (path.filename() == "data" && kittiCamera(path.parent_path())) return path.parent_path();
  for (const char* folder : {"image_0", "image_2", "image_1", "image_3"}) {
    if (fs::is_directory(path / folder)) return path / folder;
  }
  for (const char* folder : {"image_00", "image_02", "image_01", "image_03"}) {
    if (fs::is_directory(path / folder / "data")) return path / folder;
  }
  return {};
}

std::optional<DatasetLayout> findKitti(const fs::path& path) {
  fs::path folder = kittiFolder(path);
  if (folder.empty() && fs::is_directory(path)) {
    const fs::path drive = onlyDrive(path);
    if (!drive.empty()) folder = kittiFolder(drive);
  }
  if (folder.empty()) return std::nullopt;
  const fs::path base = folder.parent_path();
  const bool raw = fs::is_directory(folder / "data");
  DatasetLayout layout;
  layout.format = SequenceFormat::kKitti;
  layout.images = raw ? folder / "data" : folder;
  layout.times = existing(raw ? folder / "timestamps.txt" : base / "times.txt");
  layout.calibration =
      existing(raw ? base.parent_path() / "calib_cam_to_cam.txt" : base / "calib.txt");
  layout.masks = existingFolder(base / "masks");
  return layout;
}

std::optional<DatasetLayout> findEuroc(const fs::path& path) {
  for (const fs::path& camera :
       {path / "mav0" / "cam0", path / "cam0", path, path / "mav0" / "cam1", path / "cam1"}) {
    if (!fs::is_regular_file(camera / "data.csv") || !fs::is_directory(camera / "data")) continue;
    DatasetLayout layout;
    layout.format = SequenceFormat::kEuroc;
    layout.images = camera / "data.csv";
    layout.calibration = existing(camera / "sensor.yaml");
    layout.masks = existingFolder(camera / "masks");
    return layout;
  }
  return std::nullopt;
}

std::optional<DatasetLayout> findTum(const fs::path& path) {
  DatasetLayout layout;
  for (const char* list : {"rgb.txt", "associations.txt", "association.txt", "associate.txt"}) {
    if (layout.images.empty() && fs::is_regular_file(path / list)) layout.images = path / list;
  }
  if (layout.images.empty()) return std::nullopt;
  layout.format = SequenceFormat::kTum;
  layout.calibration = existing(path / "camera.txt");
  layout.masks = existingFolder(path / "masks");
  return layout;
}

std::optional<DatasetLayout> findImages(const fs::path& path) {
  if (!fs::is_directory(path) || !holdsImages(path)) return std::nullopt;
  DatasetLayout layout = beside(SequenceFormat::kImages, path, path);
  if (layout.times.empty()) layout.times = existing(path.parent_path() / "times.txt");
  return layout;
}

/// Calibration and photometry lie beside the file; those of a device or address are named.
DatasetLayout besideVideo(SequenceFormat format, const fs::path& file) {
  DatasetLayout layout = beside(format, file, file.parent_path());
  layout.times.clear();  // the container has them
  layout.masks.clear();  // are found by the names of image files
  return layout;
}

std::optional<DatasetLayout> findVideo(const fs::path& path) {
  if (!fs::is_regular_file(path) || hasImageSuffix(path)) return std::nullopt;
  return besideVideo(SequenceFormat::kVideo, path);
}

struct Finder {
  SequenceFormat format;
  std::optional<DatasetLayout> (*find)(const fs::path&);
  const char* expectation;
};

// In the order of recognition: from the most particular layout to the least.
constexpr std::array<Finder, 6> kFinders = {{
    {SequenceFormat::kEuroc, findEuroc, "EuRoC: mav0/cam0/data.csv and mav0/cam0/data"},
    {SequenceFormat::kKitti, findKitti, "KITTI: image_0 or image_2, of raw data image_00/data"},
    {SequenceFormat::kTum, findTum, "TUM RGB-D: rgb.txt or associations.txt"},
    {SequenceFormat::kDso, findDso, "DSO: images or images.zip"},
    {SequenceFormat::kImages, findImages, "a folder of images"},
    {SequenceFormat::kVideo, findVideo, "a video file"},
}};

/// Files that people name, and what to do with them.
void refuseWhatIsNoSequence(const fs::path& path, const fs::path& clean) {
  std::error_code error;
  if (!fs::is_regular_file(clean, error)) return;
  const std::string suffix = lowerSuffix(clean);
  if (hasImageSuffix(clean)) {
    throw IoError(fmt::format("{}: one image; expected a folder of images", path.string()));
  }
  if (suffix == ".bag" || suffix == ".mcap" || suffix == ".db3") {
    throw IoError(
        fmt::format("{}: a ROS bag, which `dsorb run` of the Python package reads", path.string()));
  }
}

}  // namespace

DatasetLayout findDataset(const fs::path& path, SequenceFormat format) {
  std::error_code error;
  const bool auto_camera = format == SequenceFormat::kAuto && isCameraAddress(path.string());
  if (auto_camera || format == SequenceFormat::kCamera) {
    if (fs::is_regular_file(path, error)) return besideVideo(SequenceFormat::kCamera, path);
    DatasetLayout layout;
    layout.format = SequenceFormat::kCamera;
    layout.images = path;
    return layout;
  }
  if (!fs::exists(path, error)) {
    throw IoError(fmt::format("{}: no such file or folder", path.string()));
  }
  // Without "." and trailing slashes, so that the parent folder is the one meant.
  fs::path clean = fs::absolute(path).lexically_normal();
  if (!clean.has_filename()) clean = clean.parent_path();
  refuseWhatIsNoSequence(path, clean);
  std::string expected;
  for (const Finder& finder : kFinders) {
    if (format != SequenceFormat::kAuto && format != finder.format) continue;
    if (auto layout = finder.find(clean)) return *layout;
    expected += (expected.empty() ? "" : "; ") + std::string(finder.expectation);
  }
  throw IoError(fmt::format("{}: no data set; expected {}", path.string(), expected));
}

}  // namespace dsorb
