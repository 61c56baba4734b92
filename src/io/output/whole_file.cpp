// SPDX-License-Identifier: BSD-3-Clause
#include "io/output/whole_file.h"

#include "io/output/output_file.h"

#include <cassert>
#include <cerrno>
#include <system_error>
#include <utility>

namespace dsorb::io {
namespace {

namespace fs = std::filesystem;

using platform::Descriptor;
using platform::Opening;

Descriptor openOrThrow(const fs::path& path, Opening opening) {
  Descriptor file = platform::openFile(path, opening);
  if (file.get() < 0) throw writeError(path);
  return file;
}

void write(const Descriptor& file, std::uintmax_t at, std::string_view text, const fs::path& path) {
  if (!platform::writeAt(file, at, text)) throw writeError(path);
}

}  // namespace

WholeFile::WholeFile(fs::path path, std::string_view content)
    : path_(std::move(path)), part_(path_.string() + kPartSuffix), end_(content) {
  replaceFile(path_, content);
  shown_ = openOrThrow(path_, Opening::kExisting);
  hidden_ = openOrThrow(part_, Opening::kEmpty);
}

WholeFile::~WholeFile() {
  std::error_code ignored;
  fs::remove(part_, ignored);
}

void WholeFile::replaceEnd(std::uintmax_t keep, std::string_view text) {
  assert(keep >= same_ && keep <= same_ + end_.size());
  const std::string_view kept(end_.data(), static_cast<std::size_t>(keep - same_));
  if (!platform::resize(hidden_, same_)) throw writeError(path_);
  write(hidden_, same_, kept, path_);
  write(hidden_, keep, text, path_);
  exchange();
  same_ = keep;
  end_ = text;
}

void WholeFile::exchange() {
  const platform::Exchange exchange = platform::exchangeNames(part_, path_);
  if (exchange == platform::Exchange::kFailed) throw writeError(path_);
  if (exchange == platform::Exchange::kReplaced) {
    // A system that cannot exchange names gets a second copy of the whole file instead.
    std::error_code error;
    if (!fs::copy_file(path_, part_, fs::copy_options::overwrite_existing, error)) {
      errno = error.value();
      throw writeError(part_);
    }
    shown_ = openOrThrow(part_, Opening::kExisting);
  }
  std::swap(shown_, hidden_);
}

}  // namespace dsorb::io
