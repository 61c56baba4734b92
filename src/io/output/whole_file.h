// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "platform/files.h"

#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>

namespace dsorb::io {

/// A file whose end is replaced again and again, and that is whole at every moment, also when the
/// program is killed. There are two copies of it: one, `<path>.part`, is brought up to date, then
/// they exchange their names. A change costs its own length, however long the file is.
class WholeFile {
 public:
  /// @throws IoError where it cannot be written
  WholeFile(std::filesystem::path path, std::string_view content);
  /// Removes the second copy.
  ~WholeFile();
  WholeFile(const WholeFile&) = delete;
  WholeFile& operator=(const WholeFile&) = delete;

  /// The content becomes its first `keep` bytes and then the text.
  /// @param keep not less than before: what was kept once cannot be changed any more
  /// @throws IoError where that cannot be written; the content is the old one then
  void replaceEnd(std::uintmax_t keep, std::string_view text);

 private:
  void exchange();

  std::filesystem::path path_;
  std::filesystem::path part_;
  platform::Descriptor shown_;   ///< of `path`
  platform::Descriptor hidden_;  ///< of `path.part`
  std::uintmax_t same_ = 0;      ///< bytes at the beginning in which both are alike
  std::string end_;              ///< what follows these in the shown one
};

}  // namespace dsorb::io
