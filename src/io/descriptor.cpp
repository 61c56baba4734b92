// SPDX-License-Identifier: BSD-3-Clause
#include "io/descriptor.h"

#include "io/output/output_file.h"

#include <unistd.h>

#include <cerrno>
#include <utility>

namespace dsorb::io {

Descriptor::~Descriptor() {
  if (descriptor_ >= 0) close(descriptor_);
}

Descriptor::Descriptor(Descriptor&& other) noexcept
    : descriptor_(std::exchange(other.descriptor_, -1)) {}

Descriptor& Descriptor::operator=(Descriptor&& other) noexcept {
  std::swap(descriptor_, other.descriptor_);
  return *this;
}

void writeAt(const Descriptor& file,
             std::uintmax_t position,
             std::string_view text,
             const std::filesystem::path& name) {
  while (!text.empty()) {
    const ssize_t done = pwrite(file.get(), text.data(), text.size(), static_cast<off_t>(position));
    if (done < 0 && errno == EINTR) continue;
    if (done <= 0) throw writeError(name);
    position += static_cast<std::uintmax_t>(done);
    text.remove_prefix(static_cast<std::size_t>(done));
  }
}

}  // namespace dsorb::io
