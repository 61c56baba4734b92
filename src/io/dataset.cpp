// SPDX-License-Identifier: BSD-3-Clause
#include "io/dataset.h"

#include "base/median.h"
#include "io/image_store.h"
#include "io/text_file.h"
#include "io/video.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <string>
#include <utility>

namespace dsorb {
namespace {

namespace fs = std::filesystem;

constexpr double kDefaultPeriod = 0.1;  // [s] between images without times
constexpr double kSecondsPerMillisecond = 1e-3;
constexpr double kNanosecondsPerSecond = 1e9;
constexpr double kMinExposure = 1e-6;         // [ms]
constexpr double kMaxExposure = 1e7;          // [ms]
constexpr double kLeastNanosecondStep = 1e5;  // 10000 images a second, or more than a day for one
constexpr double kMostNanosecondStep = 1e11;  // an image every 100 seconds, or 3000 years for one
constexpr double kLongStep = 60;              // [s] between images; nothing is tracked over it

/// Time of one image, and where it is written.
struct TimeEntry {
  double timestamp = 0;    // [s]
  double exposure_ms = 0;  // 0: not given
  int line = 0;
};

double readTime(const fs::path& file, const TextLine& line, const std::string& word) {
  return parseNumbers(file, line.number, {word}, "a time in seconds").front();
}

bool isExposure(double milliseconds) {
  return milliseconds >= kMinExposure && milliseconds <= kMaxExposure;
}

/// Lines "id seconds [exposure in ms]" of DSO's times.txt; the id is not used.
std::vector<TimeEntry> readDsoTimes(const fs::path& file) {
  std::vector<TimeEntry> entries;
  for (const TextLine& line : readLines(file, kMaxListBytes)) {
    const std::vector<std::string> words = splitWords(line.text);
    if (words.size() != 2 && words.size() != 3) {
      throw lineError(
          file,
          line.number,
          fmt::format("'{}'; expected 'id seconds [exposure_ms]'", quotable(line.text)));
    }
    TimeEntry entry{readTime(file, line, words[1]), 0, line.number};
    if (words.size() == 3) {
      entry.exposure_ms =
          parseNumbers(file, line.number, {words[2]}, "an exposure in milliseconds").front();
      if (entry.exposure_ms != 0 && !isExposure(entry.exposure_ms)) {
        throw lineError(file,
                        line.number,
                        fmt::format("exposure {}; expected 0 (not known) or {:g} to {:g} ms",
                                    words[2],
                                    kMinExposure,
                                    kMaxExposure));
      }
    }
    entries.push_back(entry);
  }
  return entries;
}

/// Lines "seconds" of KITTI's times.txt.
std::vector<TimeEntry> readKittiTimes(const fs::path& file) {
  std::vector<TimeEntry> entries;
  for (const TextLine& line : readLines(file, kMaxListBytes)) {
    entries.push_back({readTime(file, line, line.text), 0, line.number});
  }
  return entries;
}

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
                    fmt::format("time {} s is not after that of line {}, {} s",
                                entries[i].timestamp,
                                entries[i - 1].line,
                                entries[i - 1].timestamp));
  }
}

/// Median time between neighbours. @param entries at least two
double medianStep(const std::vector<TimeEntry>& entries) {
  std::vector<double> steps;
  for (std::size_t i = 1; i < entries.size(); ++i) {
    steps.push_back(entries[i].timestamp - entries[i - 1].timestamp);
  }
  return medianOf(std::move(steps));
}

/// Whole numbers a year apart, taken as seconds, are nanoseconds.
void convertNanoseconds(const fs::path& file,
                        std::vector<TimeEntry>& entries,
                        std::vector<std::string>& warnings) {
  if (entries.size() < 2) return;
  const double step = medianStep(entries);
  const bool whole = std::all_of(entries.begin(), entries.end(), [](const TimeEntry& entry) {
    return entry.timestamp == std::floor(entry.timestamp);
  });
  if (whole && step >= kLeastNanosecondStep && step <= kMostNanosecondStep) {
    for (TimeEntry& entry : entries) entry.timestamp /= kNanosecondsPerSecond;
    warnings.push_back(
        fmt::format("{}: times are taken as nanoseconds: as seconds the images would be {} s apart",
                    file.string(),
                    step));
  } else if (step > kLongStep) {
    warnings.push_back(
        fmt::format("{}: images are {} s apart; are the times in seconds?", file.string(), step));
  }
}

void assignTimes(const fs::path& file, std::vector<TimeEntry> entries, Dataset& dataset) {
  const auto images = static_cast<std::size_t>(dataset.images->size());
  if (entries.size() != images) {
    throw lineError(
        file,
        0,
        fmt::format("{} times for {} images; expected one line for each", entries.size(), images));
  }
  checkIncreasing(file, entries);
  convertNanoseconds(file, entries, dataset.warnings);
  for (const TimeEntry& entry : entries) dataset.timestamps.push_back(entry.timestamp);
  dataset.exposures = repairedExposures(entries);
}

/// Position of a KITTI image in the times file: its name is the number of its line, from 0.
std::vector<TimeEntry> kittiEntries(const fs::path& file, const ImageSource& images) {
  const std::vector<TimeEntry> all = readKittiTimes(file);
  std::vector<TimeEntry> entries;
  for (int i = 0; i < images.size(); ++i) {
    const std::string stem = fs::path(images.name(i)).stem().string();
    std::size_t number = 0;
    const auto [rest, error] = std::from_chars(stem.data(), stem.data() + stem.size(), number);
    if (error != std::errc() || rest != stem.data() + stem.size()) {
      throw IoError(fmt::format("{}: expected a name like 000000.png", images.name(i)));
    }
    if (number >= all.size()) {
      throw lineError(file, 0, fmt::format("{} times, none for {}", all.size(), images.name(i)));
    }
    entries.push_back(all[number]);
  }
  return entries;
}

/// Images named by a list, with the time of each.
struct ImageList {
  std::vector<fs::path> files;
  std::vector<TimeEntry> times;
};

/// "timestamp [ns],filename" of EuRoC's data.csv.
ImageList readEurocList(const fs::path& file) {
  ImageList list;
  for (const TextLine& line : readLines(file, kMaxListBytes)) {
    const std::size_t comma = line.text.find(',');
    const std::string_view stamp = trimmed(std::string_view(line.text).substr(0, comma));
    const std::string_view name = comma == std::string::npos
                                      ? std::string_view()
                                      : trimmed(std::string_view(line.text).substr(comma + 1));
    std::int64_t nanoseconds = 0;
    const char* end = stamp.data() + stamp.size();
    const auto [rest, error] = std::from_chars(stamp.data(), end, nanoseconds);
    if (name.empty() || error != std::errc() || rest != end) {
      throw lineError(file,
                      line.number,
                      fmt::format("'{}'; expected 'nanoseconds,filename'", quotable(line.text)));
    }
    list.files.push_back(file.parent_path() / "data" / name);
    list.times.push_back({secondsFromNanoseconds(nanoseconds), 0, line.number});
  }
  return list;
}

/// "seconds filename" of TUM's rgb.txt.
ImageList readTumList(const fs::path& file) {
  ImageList list;
  for (const TextLine& line : readLines(file, kMaxListBytes)) {
    const std::vector<std::string> words = splitWords(line.text);
    if (words.size() != 2) {
      throw lineError(
          file, line.number, fmt::format("'{}'; expected 'seconds filename'", quotable(line.text)));
    }
    list.files.push_back(file.parent_path() / words[1]);
    list.times.push_back({readTime(file, line, words[0]), 0, line.number});
  }
  return list;
}

Dataset openVideoDataset(const fs::path& file) {
  Dataset dataset;
  std::unique_ptr<VideoSource> video = openVideo(file);
  dataset.rate = video->rate();
  for (int i = 0; i < video->size(); ++i) {
    dataset.timestamps.push_back(video->begin() + i / video->rate());
  }
  dataset.images = std::move(video);
  return dataset;
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
    const ImageList list = layout.format == SequenceFormat::kEuroc ? readEurocList(layout.images)
                                                                   : readTumList(layout.images);
    if (list.files.empty()) throw lineError(layout.images, 0, "names no images");
    dataset.images = openImageList(list.files);
    assignTimes(layout.images, list.times, dataset);
    return dataset;
  }
  dataset.images = openImageStore(layout.images);
  if (layout.times.empty()) {
    if (dataset.images->size() > 1) {
      dataset.warnings.push_back(
          fmt::format("{}: no times.txt beside the images: they are taken to be {} s apart",
                      layout.images.string(),
                      kDefaultPeriod));
    }
    for (int i = 0; i < dataset.images->size(); ++i) {
      dataset.timestamps.push_back(kDefaultPeriod * i);
    }
  } else if (layout.format == SequenceFormat::kKitti) {
    assignTimes(layout.times, kittiEntries(layout.times, *dataset.images), dataset);
  } else {
    assignTimes(layout.times, readDsoTimes(layout.times), dataset);
  }
  return dataset;
}

}  // namespace dsorb
