// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/error.h"
#include "dsorb/io/sequence_reader.h"

#include "support/image_folder.h"
#include "support/temporary_folder.h"

#include <gtest/gtest.h>

#include <string>
#include <utility>
#include <vector>

namespace dsorb {

/// Small data sets in a temporary folder.
class SequenceFixture : public testing::Test {
 protected:
  /// DSO layout with `count` images of one grey level each: 10 * index.
  void writeDso(int count, const std::string& suffix = ".png") {
    writeGreyImages(root() / "images", count, suffix);
    writeText(root() / "camera.txt", "Pinhole 50 50 31.5 23.5 0\n64 48\nnone\n64 48\n");
  }
  [[nodiscard]] SequenceOptions options() const { return optionsFor(root()); }
  static SequenceOptions optionsFor(const std::filesystem::path& path) {
    SequenceOptions options;
    options.path = path.string();
    return options;
  }
  [[nodiscard]] const std::filesystem::path& root() const { return folder_.path(); }

  TemporaryFolder folder_;
};

inline std::vector<SequenceFrame> readAll(SequenceReader& reader) {
  std::vector<SequenceFrame> frames;
  while (auto frame = reader.next()) frames.push_back(std::move(*frame));
  return frames;
}

/// Indices of the images that are read.
inline std::vector<int> indicesOf(const SequenceOptions& options) {
  SequenceReader reader(options);
  std::vector<int> indices;
  for (const SequenceFrame& frame : readAll(reader)) indices.push_back(frame.index);
  EXPECT_EQ(static_cast<int>(indices.size()), reader.selected());
  return indices;
}

/// Message of the IoError that reading to the end throws.
inline std::string readingComplaint(const SequenceOptions& options) {
  try {
    SequenceReader reader(options);
    (void)readAll(reader);
  } catch (const IoError& error) {
    return error.what();
  }
  return "nothing was thrown";
}

/// Message of the exception that opening a data set throws.
inline std::string openingComplaint(const SequenceOptions& options) {
  try {
    const SequenceReader reader(options);
  } catch (const std::exception& error) {
    return error.what();
  }
  return "nothing was thrown";
}

}  // namespace dsorb
