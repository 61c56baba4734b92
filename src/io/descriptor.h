// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <filesystem>
#include <string_view>

namespace dsorb::io {

/// A file descriptor that is closed at the end of its scope.
class Descriptor {
 public:
  explicit Descriptor(int descriptor = -1) : descriptor_(descriptor) {}
  ~Descriptor();
  Descriptor(Descriptor&& other) noexcept;
  Descriptor& operator=(Descriptor&& other) noexcept;
  Descriptor(const Descriptor&) = delete;
  Descriptor& operator=(const Descriptor&) = delete;

  [[nodiscard]] int get() const { return descriptor_; }  ///< negative: there is none

 private:
  int descriptor_;
};

/// Writes all of the text at a position.
/// @param name of the file, for the message
/// @throws IoError
void writeAt(const Descriptor& file,
             std::uintmax_t position,
             std::string_view text,
             const std::filesystem::path& name);

}  // namespace dsorb::io
