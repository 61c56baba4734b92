// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <filesystem>
#include <string>

/// What the standard library has not and systems have each in their own way: files_posix.cpp,
/// files_windows.cpp. Where something fails, errno says why.
namespace dsorb::platform {

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

/// @return false: somebody else holds it. Systems and file systems without locks on folders say
///         true.
[[nodiscard]] bool lockFolder(const std::filesystem::path& folder, Descriptor& lock);

enum class Reading {
  kDone,
  kFailed,
  kTooLarge,
  kNobodyWrites,  ///< a pipe
};
/// Everything of a file or a pipe. @param text what was read is added to it
[[nodiscard]] Reading readWhole(const std::filesystem::path& file,
                                std::size_t most_bytes,
                                std::string& text);

}  // namespace dsorb::platform
