// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"

#include <cstdint>
#include <filesystem>
#include <functional>
#include <vector>

namespace dsorb {

/// One frame of a data set with its truth.
struct DatasetFrame {
  std::vector<std::uint8_t> image;   ///< row-major, of the camera's size
  std::vector<float> inverse_depth;  ///< row-major [1/m]; 0: none
  SE3 T_world_cam;
  double timestamp = 0;  ///< [s]
  double exposure = 0;   ///< [s]
};

/// Properties of a whole data set.
struct DatasetDescription {
  std::filesystem::path folder;  ///< made where missing
  PinholeCamera camera;
  int frames = 0;
  bool can_start = true;                 ///< false: no parallax, nothing may initialise
  std::vector<double> inverse_response;  ///< of the 256 pixel values; empty: no photometric files
  std::vector<float> vignette;           ///< (0, 1] row-major, of the camera's size, or empty
  int num_threads = 0;                   ///< 0: all the machine has
};

/// Writes a data set in the layout of DSO: images/, times.txt, camera.txt, with pcalib.txt and
/// vignette.png where there is a response, with groundtruth.txt (TUM, camera to world) and depth/
/// (16-bit PNG, millimetres along the optical axis, 0: none or beyond 65.5 m), and an entry in
/// sequences.json of the parent folder. Images and depth of an earlier data set are removed first.
/// @param make     frame of an index; called from several threads at once
/// @param progress told how many frames are written, from one thread at a time; may be empty
/// @throws IoError naming the file that cannot be written
void writeDataset(const DatasetDescription& description,
                  const std::function<DatasetFrame(int)>& make,
                  const std::function<void(int)>& progress = {});

}  // namespace dsorb
