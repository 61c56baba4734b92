// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/io/sequence_reader.h"

#include "io/input/image_source.h"

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

namespace dsorb {

/// Paths of the parts of a data set. A path is empty where the data set has no such file.
struct DatasetLayout {
  SequenceFormat format = SequenceFormat::kImages;  ///< never kAuto
  std::filesystem::path images;                     ///< folder, .zip, list, video or camera
  std::filesystem::path times;                      ///< of the DSO and KITTI layouts
  std::filesystem::path calibration;                ///< camera.txt, calib.txt or sensor.yaml
  std::filesystem::path response;                   ///< pcalib.txt
  std::filesystem::path vignette;                   ///< vignette.png
  std::filesystem::path masks;                      ///< folder with a mask for each image
  std::vector<std::filesystem::path> others;        ///< images that are none of the sequence
};

/// Finds the parts of a data set, by its format or by what lies there.
/// @throws IoError where the path is missing or holds no layout of that format
DatasetLayout findDataset(const std::filesystem::path& path, SequenceFormat format);

/// Images of a data set with time and exposure of each.
struct Dataset {
  std::unique_ptr<ImageSource> images;
  double rate = 0;                 ///< of a video [1/s]
  std::vector<double> timestamps;  ///< [s], strictly increasing, one per image; of a video by rate
  std::vector<double> exposures;   ///< [s], one per image; empty: unknown
  std::vector<std::string> warnings;  ///< one sentence each
};

/// Lists images and times. No image is read but the first of a video.
/// @throws IoError where there are no images, or times are malformed or of another number
Dataset openDataset(const DatasetLayout& layout);

}  // namespace dsorb
