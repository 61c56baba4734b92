// SPDX-License-Identifier: BSD-3-Clause
#include "io/input/codecs.h"

#include "dsorb/error.h"

#include <fmt/format.h>

#ifdef DSORB_CODECS_FILE
#include <dlfcn.h>
#endif

namespace dsorb {
namespace {

#ifdef DSORB_CODECS_FILE

const CodecsModule& loadModule() {
  void* library = dlopen(DSORB_CODECS_FILE, RTLD_NOW | RTLD_LOCAL);
  void* symbol = library == nullptr ? nullptr : dlsym(library, "dsorbCodecsModule");
  if (symbol == nullptr) {
    throw IoError(fmt::format(
        "{}, which reads videos and images other than PNG and JPEG (Debian package dsorb-codecs), "
        "cannot be loaded: {}",
        DSORB_CODECS_FILE,
        dlerror()));  // NOLINT(concurrency-mt-unsafe): each thread has its own in glibc
  }
  return *reinterpret_cast<decltype(&dsorbCodecsModule)>(symbol)();
}

const CodecsModule& module() {
  static const CodecsModule& loaded = loadModule();
  return loaded;
}

#else

const CodecsModule& module() {
  return *dsorbCodecsModule();
}

#endif

}  // namespace

cv::Mat decodeByOpenCv(const std::vector<std::uint8_t>& bytes) {
  return module().decode(bytes);
}

std::unique_ptr<Capture> openCapture(const std::string& address) {
  std::string why;
  std::unique_ptr<Capture> capture = module().open_capture(address, why);
  if (!capture) {
    throw IoError(fmt::format(
        "{}: {}; expected a video file, device or address with pictures", address, why));
  }
  return capture;
}

}  // namespace dsorb
