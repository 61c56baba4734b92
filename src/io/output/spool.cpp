// SPDX-License-Identifier: BSD-3-Clause
#include "io/output/spool.h"

#include "io/output/output_file.h"

#include <utility>

namespace dsorb::io {

NamelessFile::NamelessFile(std::filesystem::path folder) : folder_(std::move(folder)) {}

void NamelessFile::write(std::uintmax_t position, const void* bytes, std::size_t size) {
  if (file_.get() < 0) file_ = platform::openNameless(folder_);
  const std::string_view text(static_cast<const char*>(bytes), size);
  if (file_.get() < 0 || !platform::writeAt(file_, position, text)) throw writeError(folder_);
}

void NamelessFile::read(std::uintmax_t position, void* bytes, std::size_t size) const {
  if (platform::readAt(file_, position, bytes, size)) return;
  throw IoError(folder_.string() + ": what was put aside there cannot be read back");
}

}  // namespace dsorb::io
