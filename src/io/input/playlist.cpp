// SPDX-License-Identifier: BSD-3-Clause
#include "io/input/playlist.h"

#include "dsorb/error.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

namespace dsorb {
namespace {

constexpr std::size_t kEndless = std::size_t{1} << 30U;
constexpr double kTimeTolerance = 1e-6;  // [s] "--to 1.2" means the image at 12 * 0.1 s, too

void check(const SequenceOptions& options) {
  if (options.every < 1) {
    throw ConfigError(fmt::format("every: {}; expected 1 or more", options.every));
  }
  if (!(options.from >= 0 && options.to >= 0)) {
    throw ConfigError("from, to: seconds after the first image are expected, not negative");
  }
  if (options.to > 0 && options.to < options.from) {
    throw ConfigError(fmt::format("to: {} s is before from: {} s", options.to, options.from));
  }
}

}  // namespace

Playlist selectImages(const SequenceOptions& options,
                      int size,
                      const std::vector<double>& timestamps) {
  check(options);
  if (options.start < 0 || options.start >= size) {
    throw ConfigError(
        fmt::format("start: {} lies outside the sequence of {} images; expected 0 to {}",
                    options.start,
                    size,
                    size - 1));
  }
  int end = options.end < 0 ? size : std::min(options.end, size);
  if (end <= options.start) {
    throw ConfigError(fmt::format("end: {} is not above start: {}", options.end, options.start));
  }
  int start = options.start;
  const double begin = timestamps.front();
  const auto index_of = [&](auto time) { return static_cast<int>(time - timestamps.begin()); };
  start =
      std::max(start,
               index_of(std::lower_bound(
                   timestamps.begin(), timestamps.end(), begin + options.from - kTimeTolerance)));
  if (options.to > 0) {
    end = std::min(end,
                   index_of(std::upper_bound(
                       timestamps.begin(), timestamps.end(), begin + options.to + kTimeTolerance)));
  }
  if (end <= start) {
    throw ConfigError(fmt::format("no image is selected; the sequence takes {:g} s",
                                  timestamps.back() - timestamps.front()));
  }
  Playlist playlist;
  playlist.count = 1 + static_cast<std::size_t>((end - start - 1) / options.every);
  playlist.expected = playlist.count;
  playlist.first = options.reverse ? end - 1 : start;
  playlist.step = options.reverse ? -options.every : options.every;
  return playlist;
}

Playlist selectVideo(const SequenceOptions& options,
                     ImageSource& video,
                     double begin,
                     double rate) {
  check(options);
  if (options.reverse) throw ConfigError("reverse: a video is read forwards only");
  if (options.end >= 0 && options.end <= options.start) {
    throw ConfigError(fmt::format("end: {} is not above start: {}", options.end, options.start));
  }
  Playlist playlist;
  playlist.first = options.start;
  if (options.from > 0) {
    playlist.first = std::max(playlist.first, video.seek(options.from - kTimeTolerance));
  }
  playlist.step = options.every;
  const auto positions = [&](double end) {
    return static_cast<std::size_t>(
        std::max(0.0, std::ceil((end - playlist.first) / options.every)));
  };
  playlist.count = options.end >= 0 ? positions(options.end) : kEndless;
  playlist.expected = std::min(playlist.count, positions(video.size()));
  if (options.to > 0) {
    playlist.to = begin + options.to + kTimeTolerance;
    playlist.expected = std::min(playlist.expected, positions(std::floor(options.to * rate) + 1));
  }
  if (!video.image(playlist.first)) {
    throw ConfigError(fmt::format("no image is selected; the video has about {}", video.size()));
  }
  return playlist;
}

Playlist selectLive(const SequenceOptions& options) {
  if (options.start > 0 || options.from > 0 || options.to > 0 || options.every != 1 ||
      options.reverse) {
    throw ConfigError("start, from, to, every and reverse do not apply to a camera; end does");
  }
  Playlist playlist;
  playlist.count = options.end >= 0 ? static_cast<std::size_t>(options.end) : kEndless;
  return playlist;
}

}  // namespace dsorb
