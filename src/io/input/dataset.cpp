// SPDX-License-Identifier: BSD-3-Clause
#include "io/input/dataset.h"

#include "io/input/image_decoder.h"
#include "io/input/image_store.h"
#include "io/input/image_times.h"
#include "io/input/video.h"
#include "io/text_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cstdint>
#include <string>
#include <utility>

namespace dsorb {
namespace {

namespace fs = std::filesystem;

constexpr double kDefaultPeriod = 0.1;  // [s] between images without times
constexpr double kSecondsPerMillisecond = 1e-3;

double readTime(const fs::path& file, const TextLine& line, const std::string& word) {
  return parseNumbers(file, line.number, {word}, "a time in seconds").front();
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

void assignTimes(const fs::path& file,
                 std::vector<TimeEntry> entries,
                 Dataset& dataset,
                 bool nanoseconds = false) {
  const auto images = static_cast<std::size_t>(dataset.images->size());
  if (entries.size() != images) {
    throw lineError(
        file,
        0,
        fmt::format("{} times for {} images; expected one line for each", entries.size(), images));
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

/// "seconds filename" of TUM's rgb.txt, or two of these a line, of which one is a depth image's, of
/// its associations.txt.
ImageList readTumList(const fs::path& file) {
  ImageList list;
  for (const TextLine& line : readLines(file, kMaxListBytes)) {
    const std::vector<std::string> words = splitWords(line.text);
    if (words.size() != 2 && words.size() != 4) {
      throw lineError(file,
                      line.number,
                      fmt::format("'{}'; expected 'seconds filename', or that of an image and of "
                                  "its depth",
                                  quotable(line.text)));
    }
    const bool second = words.size() == 4 && words[1].find("depth") != std::string::npos;
    const std::size_t place = second ? 2 : 0;
    list.files.push_back(file.parent_path() / words[place + 1]);
    list.times.push_back({readTime(file, line, words[place]), 0, line.number});
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
    const ImageList list = layout.format == SequenceFormat::kEuroc ? readEurocList(layout.images)
                                                                   : readTumList(layout.images);
    if (list.files.empty()) throw lineError(layout.images, 0, "names no images");
    dataset.images = openImageList(list.files);
    const bool nanoseconds = layout.format == SequenceFormat::kEuroc;
    assignTimes(layout.images, list.times, dataset, nanoseconds);
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

}  // namespace dsorb
