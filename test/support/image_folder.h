// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fmt/format.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <zip.h>

#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>

namespace dsorb {

inline void writeText(const std::filesystem::path& file, const std::string& text) {
  std::filesystem::create_directories(file.parent_path());
  std::ofstream(file, std::ios::binary) << text;
}

inline void writeImage(const std::filesystem::path& file, const cv::Mat& image) {
  std::filesystem::create_directories(file.parent_path());
  if (!cv::imwrite(file.string(), image)) throw std::runtime_error("cannot write " + file.string());
}

/// Images 000000, 000001, ... of 64 x 48 pixels, each of one grey level: 10 * index.
inline void writeGreyImages(const std::filesystem::path& folder,
                            int count,
                            const std::string& suffix) {
  for (int i = 0; i < count; ++i) {
    writeImage(folder / fmt::format("{:06d}{}", i, suffix),
               cv::Mat(48, 64, CV_8UC1, cv::Scalar(10 * i)));
  }
}

/// Packs the files of a folder, under their names, into a new archive.
inline void zipFolder(const std::filesystem::path& folder, const std::filesystem::path& archive) {
  int code = 0;
  zip_t* zip = zip_open(archive.c_str(), ZIP_CREATE | ZIP_TRUNCATE, &code);
  if (zip == nullptr) throw std::runtime_error("cannot write " + archive.string());
  for (const auto& entry : std::filesystem::directory_iterator(folder)) {
    if (!entry.is_regular_file()) continue;
    zip_source_t* source = zip_source_file(zip, entry.path().c_str(), 0, 0);
    zip_file_add(zip, entry.path().filename().c_str(), source, ZIP_FL_OVERWRITE);
  }
  if (zip_close(zip) != 0) throw std::runtime_error("cannot write " + archive.string());
}

}  // namespace dsorb
