// SPDX-License-Identifier: BSD-3-Clause
#include "io/output/nameless_file.h"

#include "io/output/output_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <string>
#include <utility>

namespace dsorb::io {
namespace {

Descriptor openNameless(const std::filesystem::path& folder) {
  std::string name = (folder / "spool_XXXXXX").string();
  Descriptor file(mkostemp(name.data(), O_CLOEXEC));
  if (file.get() < 0 || unlink(name.c_str()) != 0) throw writeError(folder);
  return file;
}

}  // namespace

NamelessFile::NamelessFile(std::filesystem::path folder) : folder_(std::move(folder)) {}

void NamelessFile::write(std::uintmax_t position, const void* bytes, std::size_t size) {
  if (file_.get() < 0) file_ = openNameless(folder_);
  writeAt(file_, position, {static_cast<const char*>(bytes), size}, folder_);
}

void NamelessFile::read(std::uintmax_t position, void* bytes, std::size_t size) const {
  auto* target = static_cast<char*>(bytes);
  while (size > 0) {
    const ssize_t done = pread(file_.get(), target, size, static_cast<off_t>(position));
    if (done < 0 && errno == EINTR) continue;
    if (done <= 0) {
      throw IoError(folder_.string() + ": what was put aside there cannot be read back");
    }
    target += done;
    position += static_cast<std::uintmax_t>(done);
    size -= static_cast<std::size_t>(done);
  }
}

}  // namespace dsorb::io
