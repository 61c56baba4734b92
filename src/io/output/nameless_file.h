// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "platform/files.h"

#include <cstddef>
#include <cstdint>
#include <filesystem>

namespace dsorb::io {

/// A file without a name: it ends with the program, however that ends.
class NamelessFile {
 public:
  /// @param folder on whose disk it lies; the file is made when the first bytes come
  explicit NamelessFile(std::filesystem::path folder);

  /// @throws IoError where not all could be written
  void write(std::uintmax_t position, const void* bytes, std::size_t size);
  /// @throws IoError where not all could be read
  void read(std::uintmax_t position, void* bytes, std::size_t size) const;

 private:
  std::filesystem::path folder_;
  platform::Descriptor file_;
};

}  // namespace dsorb::io
