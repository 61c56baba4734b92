// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

namespace dsorb {

/// Encoded images by position. To be used by one thread at a time.
class ImageStore {
 public:
  virtual ~ImageStore() = default;
  [[nodiscard]] int size() const { return static_cast<int>(names_.size()); }
  /// File of an image, for messages and reports.
  [[nodiscard]] const std::string& name(int index) const {
    return names_[static_cast<std::size_t>(index)];
  }
  /// @throws IoError where the file cannot be read
  [[nodiscard]] virtual std::vector<std::uint8_t> read(int index) = 0;

 protected:
  explicit ImageStore(std::vector<std::string> names) : names_(std::move(names)) {}

 private:
  std::vector<std::string> names_;
};

/// Images given as a list of files, in that order.
std::unique_ptr<ImageStore> openImageList(const std::vector<std::filesystem::path>& files);

/// Images of a folder or of a .zip archive in byte-wise order of their names. Hidden files,
/// sub-folders and files without the suffix of an image are ignored.
/// @throws IoError where it is missing, unreadable, or holds no image
std::unique_ptr<ImageStore> openImageStore(const std::filesystem::path& path);

/// Whether a folder holds at least one image.
bool holdsImages(const std::filesystem::path& folder);

}  // namespace dsorb
