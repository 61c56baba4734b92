// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/rectifier.h"
#include "dsorb/io/sequence_reader.h"

#include "io/input/dataset.h"

#include <opencv2/core/types.hpp>

#include <string>
#include <vector>

namespace dsorb {

/// What a sequence is rectified with.
struct SequenceCalibration {
  Rectifier rectifier;
  Lens lens;
  BrightnessModel brightness;
  std::vector<std::string> warnings;  ///< one sentence each
};

struct FirstImage {
  cv::Size size;            ///< empty: it cannot be read, the calibration's size counts
  int turn = 0;             ///< SourceImage::turn
  double pixel_aspect = 1;  ///< SourceImage::pixel_aspect
};

/// Whether the lens is a guess: by a field of view, or because nothing is known of it.
[[nodiscard]] bool isGuess(const SequenceOptions& options, const DatasetLayout& layout);

/// Reads the calibration files that options name or that lie beside the images, and fits them to
/// the first image's size. Where they do not say how the sensor is read, it is by its rows, which
/// are columns of an image that was turned.
/// @throws IoError naming the file at fault
/// @throws ConfigError where options contradict each other or the data set
SequenceCalibration calibrateSequence(const SequenceOptions& options,
                                      const DatasetLayout& layout,
                                      const FirstImage& first);

}  // namespace dsorb
