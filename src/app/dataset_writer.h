// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "synthetic/sequence.h"

#include <filesystem>
#include <functional>

namespace dsorb::app {

/// Writes a data set in the layout of DSO: images/, times.txt, camera.txt, with pcalib.txt and
/// vignette.png where the sequence is photometric, with groundtruth.txt (TUM, camera to world) and
/// depth/ (16-bit PNG, millimetres along the optical axis, 0: none or beyond 65.5 m), and an entry
/// in sequences.json of the parent folder. Images and depth of an earlier data set are removed
/// first.
/// @param folder      made where missing
/// @param num_threads 0: all the machine has
/// @param progress    told how many frames are written; may be empty
/// @throws IoError naming the file that cannot be written
void writeDataset(const synthetic::SyntheticSequence& sequence,
                  const std::filesystem::path& folder,
                  int num_threads = 0,
                  const std::function<void(int)>& progress = {});

}  // namespace dsorb::app
