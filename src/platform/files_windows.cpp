// SPDX-License-Identifier: BSD-3-Clause
#ifdef _WIN32
#include "platform/files.h"

#include <fcntl.h>
#include <io.h>
#include <sys/stat.h>

#include <cerrno>
#include <cstdio>
#include <utility>

namespace dsorb::platform {
namespace {

constexpr unsigned kMostAtOnce = 1U << 30U;

unsigned partOf(std::size_t size) {
  return size < kMostAtOnce ? static_cast<unsigned>(size) : kMostAtOnce;
}

bool goTo(const Descriptor& file, std::uintmax_t position) {
  return _lseeki64(file.get(), static_cast<long long>(position), SEEK_SET) >= 0;
}

}  // namespace

Descriptor::~Descriptor() {
  if (descriptor_ >= 0) _close(descriptor_);
}

Descriptor::Descriptor(Descriptor&& other) noexcept
    : descriptor_(std::exchange(other.descriptor_, -1)) {}

Descriptor& Descriptor::operator=(Descriptor&& other) noexcept {
  std::swap(descriptor_, other.descriptor_);
  return *this;
}

Descriptor openNameless(const std::filesystem::path& folder) {
  for (int number = 0; number < 10000; ++number) {
    const std::filesystem::path name = folder / ("spool_" + std::to_string(number));
    const int how = _O_RDWR | _O_BINARY | _O_NOINHERIT | _O_CREAT | _O_EXCL | _O_TEMPORARY;
    Descriptor file(_wopen(name.c_str(), how, _S_IREAD | _S_IWRITE));
    if (file.get() >= 0 || errno != EEXIST) return file;
  }
  return Descriptor();
}

bool writeAt(const Descriptor& file, std::uintmax_t position, std::string_view text) {
  if (!goTo(file, position)) return false;
  while (!text.empty()) {
    const int done = _write(file.get(), text.data(), partOf(text.size()));
    if (done <= 0) return false;
    text.remove_prefix(static_cast<std::size_t>(done));
  }
  return true;
}

bool readAt(const Descriptor& file, std::uintmax_t position, void* bytes, std::size_t size) {
  if (!goTo(file, position)) return false;
  auto* target = static_cast<char*>(bytes);
  while (size > 0) {
    const int done = _read(file.get(), target, partOf(size));
    if (done <= 0) return false;
    target += done;
    size -= static_cast<std::size_t>(done);
  }
  return true;
}

bool lockFolder(const std::filesystem::path& /*folder*/, Descriptor& /*lock*/) {
  return true;
}

Reading readWhole(const std::filesystem::path& file, std::size_t most_bytes, std::string& text) {
  if (std::filesystem::is_directory(file)) {
    errno = EISDIR;
    return Reading::kFailed;
  }
  const Descriptor source(_wopen(file.c_str(), _O_RDONLY | _O_BINARY | _O_NOINHERIT));
  if (source.get() < 0) return Reading::kFailed;
  char block[1 << 12];
  while (true) {
    const int count = _read(source.get(), block, sizeof block);
    if (count == 0) return Reading::kDone;
    if (count < 0) return Reading::kFailed;
    text.append(block, static_cast<std::size_t>(count));
    if (text.size() > most_bytes) return Reading::kTooLarge;
  }
}

}  // namespace dsorb::platform
#endif
