// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/rectifier.h"
#include "dsorb/io/sequence_reader.h"

#include "io/dataset.h"

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

/// Reads the calibration files that options name or that lie beside the images, and fits them to
/// the images' size.
/// @param size of the first image; empty: it cannot be read, the calibration's size counts
/// @throws IoError naming the file at fault
/// @throws ConfigError where options contradict each other or the data set
SequenceCalibration calibrateSequence(const SequenceOptions& options,
                                      const DatasetLayout& layout,
                                      cv::Size size);

}  // namespace dsorb
