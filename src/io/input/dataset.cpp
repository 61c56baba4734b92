// SPDX-License-Identifier: BSD-3-Clause
#include "io/input/dataset.h"

#include "dsorb/error.h"

#include "base/median.h"
#include "io/input/image_decoder.h"
#include "io/input/image_source.h"
#include "io/text_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdint>
#include <cstdio>
#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace dsorb {

namespace fs = std::filesystem;

namespace {

/// Time of one image, and where it is written.
struct TimeEntry {
  double timestamp = 0;    // [s]
  double exposure_ms = 0;  // 0: not given
  int line = 0;
  fs::path image;  // where the same list names it
};

constexpr double kMinExposure = 1e-6;   // [ms]
constexpr double kMaxExposure = 1e7;    // [ms]
constexpr double kShortStep = 1e-4;     // [s] between images
constexpr double kShortestStep = 1e-3;  // [s] of a list in nanoseconds
constexpr double kLongStep = 60;        // [s] between images; nothing is tracked over it
constexpr double kLongGap = 100;        // times the usual step
// Seconds since 1970 that a camera's clock shows: 1980 to 2100.
constexpr double kFirstEpoch = 3.2e8;
constexpr double kLastEpoch = 4.1e9;
constexpr const char* kRawCalibration = "../calib_cam_to_cam.txt";  // of KITTI, for a whole day

struct Unit {
  const char* name;
  double per_second;
  /// A longer step from one image to the next is one of a smaller unit.
  double longest_step;
};
constexpr std::array<Unit, 4> kUnits = {{{"seconds", 1, 8},
                                         {"milliseconds", 1e3, 1e3},
                                         {"microseconds", 1e6, 1e6},
                                         {"nanoseconds", 1e9, 1e11}}};

/// Median time between neighbours. @param entries at least two
double medianStep(const std::vector<TimeEntry>& entries) {
  std::vector<double> steps;
  for (std::size_t i = 1; i < entries.size(); ++i) {
    steps.push_back(entries[i].timestamp - entries[i - 1].timestamp);
  }
  return medianOf(std::move(steps));
}

bool isEpoch(double first, double step, const Unit& unit) {
  const double seconds = first / unit.per_second;
  const double step_seconds = step / unit.per_second;
  return seconds >= kFirstEpoch && seconds <= kLastEpoch && step_seconds >= kShortStep &&
         step_seconds <= kLongStep;
}

/// The unit in which numbers are times of a camera; seconds where they are in none.
const Unit& unitOf(double first, double step) {
  const auto epoch = std::find_if(
      kUnits.begin(), kUnits.end(), [&](const Unit& unit) { return isEpoch(first, step, unit); });
  if (epoch != kUnits.end()) return *epoch;
  const auto relative = std::find_if(
      kUnits.begin(), kUnits.end(), [&](const Unit& unit) { return step < unit.longest_step; });
  return relative == kUnits.end() ? kUnits.front() : *relative;
}

void warnOfGap(const fs::path& file,
               const std::vector<TimeEntry>& entries,
               std::vector<std::string>& warnings) {
  const double usual = medianStep(entries);
  for (std::size_t i = 1; i < entries.size(); ++i) {
    const double step = entries[i].timestamp - entries[i - 1].timestamp;
    if (step <= kLongStep || step <= kLongGap * usual) continue;
    warnings.push_back(fmt::format(
        "{}: {:.6g} s between images {} and {}, usually {:.3g} s; was a clock set anew?",
        file.string(),
        step,
        i - 1,
        i,
        usual));
    return;
  }
}

/// "2011-09-26" and "13:02:25.964", as UTC; the days since 1970 by the Gregorian calendar.
std::optional<double> secondsOfDate(const std::string& date, const std::string& time) {
  int year = 0;
  int month = 0;
  int day = 0;
  int hour = 0;
  int minute = 0;
  double second = 0;
  if (std::sscanf(date.c_str(), "%4d-%2d-%2d", &year, &month, &day) != 3 ||
      std::sscanf(time.c_str(), "%2d:%2d:%lf", &hour, &minute, &second) != 3) {
    return std::nullopt;
  }
  const int y = month <= 2 ? year - 1 : year;  // years begin with March
  const int m = (month + 9) % 12;
  const int days = 365 * y + y / 4 - y / 100 + y / 400 + (153 * m + 2) / 5 + day - 719469;
  return ((days * 24.0 + hour) * 60 + minute) * 60 + second;
}

double readExposure(const TextLine& line, const std::string& word) {
  const double exposure = line.numbers({word}, "an exposure in milliseconds").front();
  if (exposure == 0 || (exposure >= kMinExposure && exposure <= kMaxExposure)) return exposure;
  throw line.error(
      "exposure {}; expected 0 (not known) or {:g} to {:g} ms", word, kMinExposure, kMaxExposure);
}

/// Lines "id seconds [exposure in ms]" of DSO (the id is not used), "seconds", or "2011-09-26
/// 13:02:25.964" of KITTI's raw data (taken for UTC).
/// @throws IoError naming file and line
std::vector<TimeEntry> readTimes(const fs::path& file) {
  std::vector<TimeEntry> entries;
  std::size_t columns = 0;
  for (const TextLine& line : readLines(file, kMaxListBytes)) {
    const std::vector<std::string> words = splitWords(line.text);
    if (columns == 0) columns = words.size();
    if (words.empty() || words.size() > 3 || (words.size() == 1) != (columns == 1)) {
      throw line.error(
          "'{}'; expected 'id seconds [exposure_ms]', or the seconds alone in every line",
          quotable(line.text));
    }
    TimeEntry entry{0, 0, line.number, {}};
    const auto date = words.size() == 2 ? secondsOfDate(words[0], words[1]) : std::nullopt;
    const std::string& number = words.size() == 1 ? words[0] : words[1];
    entry.timestamp = date ? *date : line.numbers({number}, "a time in seconds").front();
    if (words.size() == 3) entry.exposure_ms = readExposure(line, words[2]);
    entries.push_back(entry);
  }
  return entries;
}

/// Times that the names of images are, as TUM-RGBD, EuRoC and extractors of bags name them: one
/// number behind one prefix, increasing, such that as seconds, milliseconds, microseconds or
/// nanoseconds they are times of a camera. Not yet in seconds.
std::optional<std::vector<TimeEntry>> timesInNames(const ImageSource& images) {
  std::vector<TimeEntry> entries;
  std::string prefix;
  bool fractions = false;
  for (int i = 0; i < images.size(); ++i) {
    const std::string stem = fs::path(images.name(i)).stem().string();
    const std::string before = stem.substr(0, stem.find_first_of("0123456789"));
    if (i == 0) prefix = before;
    TimeEntry entry;
    const char* const end = stem.data() + stem.size();
    const auto [rest, error] = std::from_chars(
        stem.data() + before.size(), end, entry.timestamp, std::chars_format::fixed);
    if (before != prefix || error != std::errc() || rest != end) return std::nullopt;
    if (i > 0 && entry.timestamp <= entries.back().timestamp) return std::nullopt;
    fractions = fractions || stem.find('.') != std::string::npos;
    entries.push_back(entry);
  }
  if (entries.size() < 2) return std::nullopt;
  const double first = entries.front().timestamp;
  const double step = medianStep(entries);
  const Unit& unit = unitOf(first, step);
  const bool relative =
      fractions ? &unit == &kUnits.front() && step >= kShortestStep : &unit == &kUnits.back();
  if (!isEpoch(first, step, unit) && !relative) return std::nullopt;
  return entries;
}

/// Turns times that are no camera's in the unit that they should have into seconds, and says so; in
/// that unit they are turned into seconds otherwise. Gaps that no camera makes are told.
/// @param file that has them, for messages
/// @param nanoseconds whether they should be nanoseconds, and are divided already; else seconds
/// @param warnings one sentence each
void settleUnit(const fs::path& file,
                bool nanoseconds,
                std::vector<TimeEntry>& entries,
                std::vector<std::string>& warnings) {
  if (entries.size() < 2) return;
  const Unit& expected = nanoseconds ? kUnits[3] : kUnits[0];
  const double step = medianStep(entries);
  const Unit& unit =
      nanoseconds && step >= kShortestStep
          ? expected
          : unitOf(entries.front().timestamp * expected.per_second, step * expected.per_second);
  if (&unit != &expected) {
    const double factor = expected.per_second / unit.per_second;
    for (TimeEntry& entry : entries) {
      entry.timestamp = factor < 1 ? entry.timestamp / unit.per_second : entry.timestamp * factor;
    }
    warnings.push_back(
        fmt::format("{}: times are taken as {}: as {} the images would be {:.3g} s apart",
                    file.string(),
                    unit.name,
                    expected.name,
                    step));
  } else if (step > kLongStep || step < kShortStep) {
    warnings.push_back(fmt::format(
        "{}: images are {:.3g} s apart; are the times in {}?", file.string(), step, expected.name));
  }
  warnOfGap(file, entries, warnings);
}

constexpr double kDefaultPeriod = 0.1;  // [s] between images without times
constexpr double kSecondsPerMillisecond = 1e-3;

/// An exposure of 0 becomes the mean of its neighbours that are known; the one before may be
/// repaired already. @return seconds; empty where some stay unknown
std::vector<double> repairedExposures(std::vector<TimeEntry> entries) {
  std::vector<double> exposures;
  exposures.reserve(entries.size());
  for (std::size_t i = 0; i < entries.size(); ++i) {
    double& exposure = entries[i].exposure_ms;
    if (exposure == 0) {
      const double before = i > 0 ? entries[i - 1].exposure_ms : 0;
      const double after = i + 1 < entries.size() ? entries[i + 1].exposure_ms : 0;
      exposure = before > 0 && after > 0 ? 0.5 * (before + after) : std::max(before, after);
    }
    if (exposure == 0) return {};
    exposures.push_back(exposure * kSecondsPerMillisecond);
  }
  return exposures;
}

void checkIncreasing(const fs::path& file, const std::vector<TimeEntry>& entries) {
  for (std::size_t i = 1; i < entries.size(); ++i) {
    if (entries[i].timestamp > entries[i - 1].timestamp) continue;
    throw lineError(file,
                    entries[i].line,
                    "time {} s is not after that of line {}, {} s",
                    entries[i].timestamp,
                    entries[i - 1].line,
                    entries[i - 1].timestamp);
  }
}

void assignTimes(const fs::path& file,
                 std::vector<TimeEntry> entries,
                 Dataset& dataset,
                 bool nanoseconds = false) {
  const auto images = static_cast<std::size_t>(dataset.images->size());
  if (entries.size() != images) {
    throw fileError(
        file, "{} times for {} images; expected one line for each", entries.size(), images);
  }
  checkIncreasing(file, entries);
  settleUnit(file, nanoseconds, entries, dataset.warnings);
  for (const TimeEntry& entry : entries) dataset.timestamps.push_back(entry.timestamp);
  dataset.exposures = repairedExposures(entries);
}

/// Position of a KITTI image in the times file: its name is the number of its line, from 0.
std::vector<TimeEntry> kittiEntries(const fs::path& file, const ImageSource& images) {
  const std::vector<TimeEntry> all = readTimes(file);
  std::vector<TimeEntry> entries;
  for (int i = 0; i < images.size(); ++i) {
    const std::string stem = fs::path(images.name(i)).stem().string();
    std::size_t number = 0;
    const auto [rest, error] = std::from_chars(stem.data(), stem.data() + stem.size(), number);
    if (error != std::errc() || rest != stem.data() + stem.size()) {
      throw fileError(images.name(i), "expected a name like 000000.png");
    }
    if (number >= all.size()) {
      throw fileError(file, "{} times, none for {}", all.size(), images.name(i));
    }
    entries.push_back(all[number]);
  }
  return entries;
}

/// "timestamp [ns],filename" of EuRoC's data.csv.
TimeEntry eurocEntry(const fs::path& folder, const TextLine& line) {
  const std::string_view text = line.text;
  const std::size_t comma = text.find(',');
  const std::string_view stamp = trimmed(text.substr(0, comma));
  const auto name = trimmed(comma == text.npos ? std::string_view() : text.substr(comma + 1));
  std::int64_t nanoseconds = 0;
  const char* end = stamp.data() + stamp.size();
  const auto [rest, error] = std::from_chars(stamp.data(), end, nanoseconds);
  if (name.empty() || error != std::errc() || rest != end) {
    throw line.error("'{}'; expected 'nanoseconds,filename'", quotable(text));
  }
  return {secondsFromNanoseconds(nanoseconds), 0, line.number, folder / "data" / name};
}

/// "seconds filename" of TUM's rgb.txt, or two of these a line, of which one is a depth image's, of
/// its associations.txt.
TimeEntry tumEntry(const fs::path& folder, const TextLine& line) {
  const std::vector<std::string> words = splitWords(line.text);
  if (words.size() != 2 && words.size() != 4) {
    throw line.error("'{}'; expected 'seconds filename', or that of an image and of its depth",
                     quotable(line.text));
  }
  const bool second = words.size() == 4 && words[1].find("depth") != std::string::npos;
  const std::size_t place = second ? 2 : 0;
  const double time = line.numbers({words[place]}, "a time in seconds").front();
  return {time, 0, line.number, folder / words[place + 1]};
}

Dataset openVideoDataset(const fs::path& file) {
  Dataset dataset;
  std::unique_ptr<ImageSource> video = openVideo(file);
  dataset.rate = video->rate();
  for (int i = 0; i < video->size(); ++i) {
    dataset.timestamps.push_back(video->begin() + i / video->rate());
  }
  dataset.images = std::move(video);
  return dataset;
}

/// Takes the times from the names of the images, or spaces them equally.
void assignTimesWithoutFile(const fs::path& images, Dataset& dataset) {
  if (auto entries = timesInNames(*dataset.images)) {
    std::vector<std::string> unit;
    settleUnit(images, false, *entries, unit);
    dataset.warnings.push_back(
        fmt::format("{}: no times.txt beside the images: their names are taken for their times",
                    images.string()));
    dataset.warnings.insert(dataset.warnings.end(), unit.begin(), unit.end());
    for (const TimeEntry& entry : *entries) dataset.timestamps.push_back(entry.timestamp);
    return;
  }
  if (dataset.images->size() > 1) {
    dataset.warnings.push_back(
        fmt::format("{}: no times.txt beside the images: they are taken to be {} s apart",
                    images.string(),
                    kDefaultPeriod));
  }
  for (int i = 0; i < dataset.images->size(); ++i) dataset.timestamps.push_back(kDefaultPeriod * i);
}

}  // namespace

Dataset openDataset(const DatasetLayout& layout) {
  if (layout.format == SequenceFormat::kVideo) return openVideoDataset(layout.images);
  Dataset dataset;
  if (layout.format == SequenceFormat::kCamera) {
    dataset.images = openCamera(layout.images.string());
    return dataset;
  }
  if (layout.format == SequenceFormat::kEuroc || layout.format == SequenceFormat::kTum) {
    const bool euroc = layout.format == SequenceFormat::kEuroc;
    std::vector<TimeEntry> entries;
    std::vector<fs::path> files;
    for (const TextLine& line : readLines(layout.images, kMaxListBytes)) {
      entries.push_back((euroc ? eurocEntry : tumEntry)(layout.images.parent_path(), line));
      files.push_back(entries.back().image);
    }
    if (files.empty()) throw fileError(layout.images, "names no images");
    dataset.images = openImageList(files);
    assignTimes(layout.images, std::move(entries), dataset, euroc);
    return dataset;
  }
  auto images = openImageStore(layout.images, layout.others);
  for (const std::string& name : images->leftOut()) {
    const char* why = hasImageSuffix(name) ? "not taken for an image of the sequence"
                                           : "not read inside of an archive; put it beside it";
    dataset.warnings.push_back(fmt::format("{}: {}", name, why));
  }
  dataset.images = std::move(images);
  if (layout.times.empty()) {
    assignTimesWithoutFile(layout.images, dataset);
  } else if (layout.format == SequenceFormat::kKitti) {
    assignTimes(layout.times, kittiEntries(layout.times, *dataset.images), dataset);
  } else {
    assignTimes(layout.times, readTimes(layout.times), dataset);
  }
  return dataset;
}

namespace {

/// Where a format has its images and what belongs to them, relative to the folder of a data set.
struct Place {
  SequenceFormat format;
  const char* images;
  const char* base;         // of the files beside them
  const char* calibration;  // from there
  const char* times;        // from there
};

// In the order of recognition: from the most particular layout to the least; grey images first.
constexpr std::array<Place, 19> kPlaces = {
    {{SequenceFormat::kEuroc, "mav0/cam0/data.csv", "mav0/cam0", "sensor.yaml", ""},
     {SequenceFormat::kEuroc, "cam0/data.csv", "cam0", "sensor.yaml", ""},
     {SequenceFormat::kEuroc, "data.csv", "", "sensor.yaml", ""},
     {SequenceFormat::kEuroc, "mav0/cam1/data.csv", "mav0/cam1", "sensor.yaml", ""},
     {SequenceFormat::kEuroc, "cam1/data.csv", "cam1", "sensor.yaml", ""},
     {SequenceFormat::kKitti, "image_0", "", "calib.txt", "times.txt"},
     {SequenceFormat::kKitti, "image_2", "", "calib.txt", "times.txt"},
     {SequenceFormat::kKitti, "image_1", "", "calib.txt", "times.txt"},
     {SequenceFormat::kKitti, "image_3", "", "calib.txt", "times.txt"},
     {SequenceFormat::kKitti, "image_00/data", "", kRawCalibration, "image_00/timestamps.txt"},
     {SequenceFormat::kKitti, "image_02/data", "", kRawCalibration, "image_02/timestamps.txt"},
     {SequenceFormat::kKitti, "image_01/data", "", kRawCalibration, "image_01/timestamps.txt"},
     {SequenceFormat::kKitti, "image_03/data", "", kRawCalibration, "image_03/timestamps.txt"},
     {SequenceFormat::kTum, "rgb.txt", "", "camera.txt", ""},
     {SequenceFormat::kTum, "associations.txt", "", "camera.txt", ""},
     {SequenceFormat::kTum, "association.txt", "", "camera.txt", ""},
     {SequenceFormat::kTum, "associate.txt", "", "camera.txt", ""},
     {SequenceFormat::kDso, "images", "", "camera.txt", "times.txt"},
     {SequenceFormat::kDso, "images.zip", "", "camera.txt", "times.txt"}}};

/// The file when it exists, else an empty path. What else has its name, a folder or a broken link,
/// is left to those who read it: they complain.
fs::path existing(const fs::path& file) {
  return fs::symlink_status(file).type() == fs::file_type::not_found ? fs::path() : file;
}

/// Files that lie beside the images.
DatasetLayout beside(SequenceFormat format,
                     const fs::path& images,
                     const fs::path& base,
                     const char* calibration = "camera.txt",
                     const char* times = "times.txt") {
  DatasetLayout layout;
  layout.format = format;
  layout.images = images;
  if (*times != 0) layout.times = existing(base / times);
  layout.calibration = existing((base / calibration).lexically_normal());
  layout.response = existing(base / "pcalib.txt");
  layout.vignette = existing(base / "vignette.png");
  if (fs::is_directory(base / "masks")) layout.masks = base / "masks";
  return layout;
}

/// The one drive below the folder of a day of KITTI's raw data; empty: it is no such folder.
fs::path onlyDrive(const fs::path& day) {
  fs::path drive;
  if (!fs::is_regular_file(day / "calib_cam_to_cam.txt")) return drive;
  for (const fs::directory_entry& entry : fs::directory_iterator(day)) {
    const bool is_drive = entry.path().string().find("_drive_") != std::string::npos;
    if (!entry.is_directory() || !is_drive) continue;
    if (!drive.empty()) {
      throw fileError(day,
                      "several drives, as {} and {}; name one",
                      drive.filename().string(),
                      entry.path().filename().string());
    }
    drive = entry.path();
  }
  return drive;
}

/// The layout of a place in a folder, which the path has or, of KITTI, lies in.
std::optional<DatasetLayout> layoutAt(const Place& place,
                                      const fs::path& folder,
                                      const fs::path& path) {
  const fs::path images = folder / place.images;
  const bool below = *images.lexically_relative(path).begin() != "..";
  const bool euroc = place.format == SequenceFormat::kEuroc;
  if (!below || !fs::exists(images)) return std::nullopt;
  if (euroc && !fs::is_directory(images.parent_path() / "data")) return std::nullopt;
  const fs::path base = *place.base == 0 ? folder : folder / place.base;
  return beside(place.format, images, base, place.calibration, place.times);
}

std::optional<DatasetLayout> findPlace(SequenceFormat format, const fs::path& path) {
  std::vector<fs::path> folders = {path};
  if (format == SequenceFormat::kKitti) {
    for (const fs::path& other :
         {path.parent_path(), path.parent_path().parent_path(), onlyDrive(path)}) {
      if (!other.empty()) folders.push_back(other);
    }
  }
  for (const Place& place : kPlaces) {
    if (place.format != format) continue;
    for (const fs::path& folder : folders) {
      if (auto layout = layoutAt(place, folder, path)) return layout;
    }
  }
  return std::nullopt;
}

/// Beside the places: an archive, and a folder of images beside a calibration.
std::optional<DatasetLayout> findDso(const fs::path& path) {
  const bool archive = fs::is_regular_file(path) && lowerSuffix(path) == ".zip";
  if (archive) return beside(SequenceFormat::kDso, path, path.parent_path());
  if (auto layout = findPlace(SequenceFormat::kDso, path)) return layout;
  const bool folder = fs::is_directory(path) && holdsImages(path) &&
                      fs::is_regular_file(path.parent_path() / "camera.txt");
  if (!folder) return std::nullopt;
  return beside(SequenceFormat::kDso, path, path.parent_path());
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

std::optional<DatasetLayout> find(SequenceFormat format, const fs::path& path) {
  if (format == SequenceFormat::kDso) return findDso(path);
  if (format == SequenceFormat::kImages) return findImages(path);
  if (format != SequenceFormat::kVideo) return findPlace(format, path);
  if (!fs::is_regular_file(path) || hasImageSuffix(path)) return std::nullopt;
  return besideVideo(format, path);
}

constexpr std::array<std::pair<SequenceFormat, const char*>, 6> kExpectations = {{
    {SequenceFormat::kEuroc, "EuRoC: mav0/cam0/data.csv and mav0/cam0/data"},
    {SequenceFormat::kKitti, "KITTI: image_0 or image_2, of raw data image_00/data"},
    {SequenceFormat::kTum, "TUM RGB-D: rgb.txt or associations.txt"},
    {SequenceFormat::kDso, "DSO: images or images.zip"},
    {SequenceFormat::kImages, "a folder of images"},
    {SequenceFormat::kVideo, "a video file"},
}};

/// Files that people name, and what to do with them.
void refuseWhatIsNoSequence(const fs::path& path, const fs::path& clean) {
  std::error_code error;
  if (!fs::is_regular_file(clean, error)) return;
  const std::string suffix = lowerSuffix(clean);
  if (hasImageSuffix(clean)) throw fileError(path, "one image; expected a folder of images");
  if (suffix == ".bag" || suffix == ".mcap" || suffix == ".db3") {
    throw fileError(path, "a ROS bag, which `dsorb run` of the Python package reads");
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
  if (!fs::exists(path, error)) throw fileError(path, "no such file or folder");
  // Without "." and trailing slashes, so that the parent folder is the one meant.
  fs::path clean = fs::absolute(path).lexically_normal();
  if (!clean.has_filename()) clean = clean.parent_path();
  refuseWhatIsNoSequence(path, clean);
  std::string expected;
  for (const auto& [own, expectation] : kExpectations) {
    if (format != SequenceFormat::kAuto && format != own) continue;
    if (auto layout = find(own, clean)) return *layout;
    expected += (expected.empty() ? "" : "; ") + std::string(expectation);
  }
  throw fileError(path, "no data set; expected {}", expected);
}

}  // namespace dsorb
