// SPDX-License-Identifier: BSD-3-Clause
#include "io/output/whole_file.h"

#include "io/output/output_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cassert>
#include <cerrno>
#include <cstdio>
#include <system_error>
#include <utility>

namespace dsorb::io {
namespace {

namespace fs = std::filesystem;

Descriptor openDescriptor(const fs::path& path, int how) {
  Descriptor file(open(path.c_str(), O_RDWR | O_CLOEXEC | how, 0666));
  if (file.get() < 0) throw writeError(path);
  return file;
}

}  // namespace

WholeFile::WholeFile(fs::path path, std::string_view content)
    : path_(std::move(path)), part_(path_.string() + kPartSuffix), end_(content) {
  replaceFile(path_, content);
  shown_ = openDescriptor(path_, 0);
  hidden_ = openDescriptor(part_, O_CREAT | O_TRUNC);
}

WholeFile::~WholeFile() {
  std::error_code ignored;
  fs::remove(part_, ignored);
}

void WholeFile::replaceEnd(std::uintmax_t keep, std::string_view text) {
  assert(keep >= same_ && keep <= same_ + end_.size());
  const std::string_view kept(end_.data(), static_cast<std::size_t>(keep - same_));
  if (ftruncate(hidden_.get(), static_cast<off_t>(same_)) != 0) throw writeError(path_);
  writeAt(hidden_, same_, kept, path_);
  writeAt(hidden_, keep, text, path_);
  exchange();
  same_ = keep;
  end_ = text;
}

void WholeFile::exchange() {
  const char* path = path_.c_str();
  const char* part = part_.c_str();
  if (renameat2(AT_FDCWD, part, AT_FDCWD, path, RENAME_EXCHANGE) != 0) {
    if (errno != EINVAL && errno != ENOSYS) throw writeError(path_);
    // A file system that cannot exchange names gets a second copy of the whole file instead.
    if (std::rename(part, path) != 0) throw writeError(path_);
    std::error_code error;
    if (!fs::copy_file(path_, part_, error)) {
      errno = error.value();
      throw writeError(part_);
    }
    shown_ = openDescriptor(part_, 0);
  }
  std::swap(shown_, hidden_);
}

}  // namespace dsorb::io
