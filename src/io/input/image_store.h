// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "io/input/image_source.h"

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <utility>
#include <vector>

namespace dsorb {

/// Encoded images by position.
class ImageStore : public ImageSource {
 public:
  [[nodiscard]] int size() const final { return static_cast<int>(names_.size()); }
  /// File of an image.
  [[nodiscard]] std::string name(int index) const final {
    return names_[static_cast<std::size_t>(index)];
  }
  [[nodiscard]] std::optional<SourceImage> image(int index) final;
  void expect(cv::Size size) final { expected_ = size; }
  /// Files that look as if they were read and are not: images that are none of the sequence, and in
  /// an archive what is read beside it.
  [[nodiscard]] const std::vector<std::string>& leftOut() const { return left_out_; }
  void setLeftOut(std::vector<std::string> names) { left_out_ = std::move(names); }
  /// @throws IoError where the file cannot be read
  [[nodiscard]] virtual std::vector<std::uint8_t> read(int index) = 0;

 protected:
  explicit ImageStore(std::vector<std::string> names) : names_(std::move(names)) {}

 private:
  std::vector<std::string> names_;
  std::vector<std::string> left_out_;
  cv::Size expected_;  // empty: any
};

/// Images given as a list of files, in that order.
std::unique_ptr<ImageStore> openImageList(const std::vector<std::filesystem::path>& files);

/// Images of a folder or of a .zip archive in the order of their names, numbers in them by
/// value. Hidden files, sub-folders and files without the suffix of an image are ignored; images
/// without a number among numbered ones, as a vignette or a mask, are left out.
/// @param others  images that may lie there, too, and are none of the sequence
/// @throws IoError where it is missing, unreadable, or holds no image
std::unique_ptr<ImageStore> openImageStore(const std::filesystem::path& path,
                                           const std::vector<std::filesystem::path>& others = {});

/// Whether a folder holds at least one image.
bool holdsImages(const std::filesystem::path& folder);

}  // namespace dsorb
