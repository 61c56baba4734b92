// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/io/sequence_reader.h"

#include "io/input/image_source.h"

#include <cstddef>
#include <optional>
#include <vector>

namespace dsorb {

/// Which images of a source are read, in this order.
struct Playlist {
  std::size_t count = 0;     ///< at most; images may end before
  std::size_t expected = 0;  ///< number of images as far as known
  int first = 0;
  int step = 1;              ///< negative: backwards
  std::optional<double> to;  ///< [s]: nothing after it, where times come with the images

  [[nodiscard]] int index(std::size_t position) const {
    return first + static_cast<int>(position) * step;
  }
  [[nodiscard]] bool isAfterEnd(std::optional<double> timestamp) const {
    return to && timestamp && *timestamp > *to;
  }
};

/// Images selected by start, end, from, to, every and reverse.
/// @param timestamps [s], one for each image
/// @throws ConfigError where nothing is selected
Playlist selectImages(const SequenceOptions& options,
                      int size,
                      const std::vector<double>& timestamps);

/// Images of a video selected by start, end, from, to and every.
/// @param begin, rate time of the first image [s], and images per second
/// @throws ConfigError where nothing is selected, and on `reverse`
Playlist selectVideo(const SequenceOptions& options, ImageSource& video, double begin, double rate);

/// Images of a camera: `end` of them, or without end.
/// @throws ConfigError on any other selection
Playlist selectLive(const SequenceOptions& options);

}  // namespace dsorb
