// SPDX-License-Identifier: BSD-3-Clause
#ifdef _WIN32
#include "platform/files.h"

#include <fcntl.h>
#include <io.h>
#include <sys/stat.h>

#include <cerrno>
#include <utility>

namespace dsorb::platform {

Descriptor::~Descriptor() {
  if (descriptor_ >= 0) _close(descriptor_);
}

Descriptor::Descriptor(Descriptor&& other) noexcept
    : descriptor_(std::exchange(other.descriptor_, -1)) {}

Descriptor& Descriptor::operator=(Descriptor&& other) noexcept {
  std::swap(descriptor_, other.descriptor_);
  return *this;
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
