// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <opencv2/core/mat.hpp>

#include <filesystem>
#include <string>

namespace dsorb {

/// Masks of a sequence: one for all images, or one for each.
class ImageMasks {
 public:
  /// No masks.
  ImageMasks() = default;
  /// @param given   file or folder the user named; empty: none
  /// @param found   folder beside the images; empty: none
  /// @param width   of the images [px]
  /// @throws IoError where what is given is missing, or the one mask is none of this size
  ImageMasks(const std::string& given, const std::filesystem::path& found, int width, int height);

  /// The mask of all images; empty: none.
  [[nodiscard]] const cv::Mat& common() const { return common_; }
  /// The mask of one image alone: under the image's name, or with .png after or instead of its
  /// suffix. Empty where images have none of their own.
  /// @throws IoError where it is missing, unreadable or of another size
  [[nodiscard]] cv::Mat of(const std::string& image) const;

 private:
  [[nodiscard]] cv::Mat read(const std::filesystem::path& file) const;

  std::filesystem::path folder_;
  cv::Mat common_;
  int width_ = 0;
  int height_ = 0;
};

}  // namespace dsorb
