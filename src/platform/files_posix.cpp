// SPDX-License-Identifier: BSD-3-Clause
#ifndef _WIN32
#include "platform/files.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <utility>

namespace dsorb::platform {
namespace {

constexpr std::size_t kBlockBytes = 1 << 16;
constexpr int kPipePatience = 2000;  // for the first byte of a pipe [ms]

}  // namespace

Descriptor::~Descriptor() {
  if (descriptor_ >= 0) close(descriptor_);
}

Descriptor::Descriptor(Descriptor&& other) noexcept
    : descriptor_(std::exchange(other.descriptor_, -1)) {}

Descriptor& Descriptor::operator=(Descriptor&& other) noexcept {
  std::swap(descriptor_, other.descriptor_);
  return *this;
}

bool lockFolder(const std::filesystem::path& folder, Descriptor& lock) {
  lock = Descriptor(open(folder.c_str(), O_RDONLY | O_DIRECTORY | O_CLOEXEC));
  return lock.get() < 0 || flock(lock.get(), LOCK_EX | LOCK_NB) == 0 || errno != EWOULDBLOCK;
}

Reading readWhole(const std::filesystem::path& file, std::size_t most_bytes, std::string& text) {
  // A pipe without a writer does not block this.
  const Descriptor source(open(file.c_str(), O_RDONLY | O_NONBLOCK | O_CLOEXEC));
  struct stat status {};
  if (source.get() < 0 || fstat(source.get(), &status) != 0) return Reading::kFailed;
  if (S_ISDIR(status.st_mode)) {
    errno = EISDIR;
    return Reading::kFailed;
  }
  const bool regular = S_ISREG(status.st_mode);
  if (regular && static_cast<std::size_t>(status.st_size) > most_bytes) return Reading::kTooLarge;
  std::array<char, kBlockBytes> block{};
  while (true) {
    pollfd request{source.get(), POLLIN, 0};
    const bool ready = poll(&request, 1, kPipePatience) != 0;
    const ssize_t count = read(source.get(), block.data(), block.size());
    if (count == 0) return ready ? Reading::kDone : Reading::kNobodyWrites;
    if (count < 0 && (errno == EAGAIN || errno == EINTR)) continue;
    if (count < 0) return Reading::kFailed;
    text.append(block.data(), static_cast<std::size_t>(count));
    if (text.size() > most_bytes) return Reading::kTooLarge;
  }
}

}  // namespace dsorb::platform
#endif
