// SPDX-License-Identifier: BSD-3-Clause
#include "io/input/image_times.h"

#include "base/median.h"
#include "io/text_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdio>
#include <string_view>
#include <utility>

namespace dsorb {
namespace {

namespace fs = std::filesystem;

constexpr double kMinExposure = 1e-6;   // [ms]
constexpr double kMaxExposure = 1e7;    // [ms]
constexpr double kShortStep = 1e-4;     // [s] between images
constexpr double kShortestStep = 1e-3;  // [s] of a list in nanoseconds
constexpr double kLongStep = 60;        // [s] between images; nothing is tracked over it
constexpr double kLongGap = 100;        // times the usual step
// Seconds since 1970 that a camera's clock shows: 1980 to 2100.
constexpr double kFirstEpoch = 3.2e8;
constexpr double kLastEpoch = 4.1e9;
// Steps of clocks that begin with the recording, in their units: as seconds nothing is tracked over
// the first.
constexpr double kLeastMilliseconds = 8;
constexpr double kLeastMicroseconds = 1e3;
constexpr double kLeastNanoseconds = 1e6;
constexpr double kMostNanoseconds = 1e11;

struct Unit {
  const char* name;
  double per_second;
};
constexpr std::array<Unit, 4> kUnits = {
    {{"seconds", 1}, {"milliseconds", 1e3}, {"microseconds", 1e6}, {"nanoseconds", 1e9}}};

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

/// The unit in which numbers are times of a camera.
const Unit& unitOf(double first, double step) {
  for (const Unit& unit : kUnits) {
    if (isEpoch(first, step, unit)) return unit;
  }
  if (step < kLeastMilliseconds || step > kMostNanoseconds) return kUnits[0];
  if (step < kLeastMicroseconds) return kUnits[1];
  return step < kLeastNanoseconds ? kUnits[2] : kUnits[3];
}

std::string stepText(double seconds) {
  return seconds < kShortStep ? fmt::format("{:.3g} s", seconds) : fmt::format("{:.6g} s", seconds);
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
  const double days = 365.0 * y + y / 4 - y / 100 + y / 400 + (153 * m + 2) / 5 + day - 719469;
  return ((days * 24 + hour) * 60 + minute) * 60 + second;
}

double readExposure(const fs::path& file, const TextLine& line, const std::string& word) {
  const double exposure =
      parseNumbers(file, line.number, {word}, "an exposure in milliseconds").front();
  if (exposure == 0 || (exposure >= kMinExposure && exposure <= kMaxExposure)) return exposure;
  throw lineError(file,
                  line.number,
                  fmt::format("exposure {}; expected 0 (not known) or {:g} to {:g} ms",
                              word,
                              kMinExposure,
                              kMaxExposure));
}

}  // namespace

std::vector<TimeEntry> readTimes(const fs::path& file) {
  std::vector<TimeEntry> entries;
  std::size_t columns = 0;
  for (const TextLine& line : readLines(file, kMaxListBytes)) {
    const std::vector<std::string> words = splitWords(line.text);
    if (columns == 0) columns = words.size();
    if (words.empty() || words.size() > 3 || (words.size() == 1) != (columns == 1)) {
      throw lineError(file,
                      line.number,
                      fmt::format("'{}'; expected 'id seconds [exposure_ms]', or the seconds alone "
                                  "in every line",
                                  quotable(line.text)));
    }
    TimeEntry entry{0, 0, line.number};
    const auto date = words.size() == 2 ? secondsOfDate(words[0], words[1]) : std::nullopt;
    const std::string& number = words.size() == 1 ? words[0] : words[1];
    entry.timestamp =
        date ? *date : parseNumbers(file, line.number, {number}, "a time in seconds").front();
    if (words.size() == 3) entry.exposure_ms = readExposure(file, line, words[2]);
    entries.push_back(entry);
  }
  return entries;
}

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
  const bool recent = isEpoch(first, step, unit);
  const bool relative = fractions ? unit.per_second == 1 && step >= kShortestStep
                                  : step >= kLeastNanoseconds && step <= kMostNanoseconds;
  if (!recent && !relative) return std::nullopt;
  return entries;
}

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
    warnings.push_back(fmt::format("{}: times are taken as {}: as {} the images would be {} apart",
                                   file.string(),
                                   unit.name,
                                   expected.name,
                                   stepText(step)));
  } else if (step > kLongStep || step < kShortStep) {
    warnings.push_back(fmt::format("{}: images are {} apart; are the times in {}?",
                                   file.string(),
                                   stepText(step),
                                   expected.name));
  }
  warnOfGap(file, entries, warnings);
}

}  // namespace dsorb
