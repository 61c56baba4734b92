// SPDX-License-Identifier: BSD-3-Clause
#ifndef _WIN32
#include "platform/process.h"

#include <fcntl.h>
#include <sys/resource.h>
#include <unistd.h>

#include <csignal>
#include <fstream>
#include <string>
#include <string_view>

namespace dsorb::platform {

double peakMemory() {
  std::ifstream status("/proc/self/status");  // of Linux
  const std::string_view key = "VmHWM:";
  for (std::string line; std::getline(status, line);) {
    if (line.compare(0, key.size(), key) == 0) return std::stod(line.substr(key.size())) / 1024.0;
  }
  rusage usage{};
  getrusage(RUSAGE_SELF, &usage);
#ifdef __APPLE__
  constexpr double kPerMebibyte = 1024.0 * 1024.0;  // bytes
#else
  constexpr double kPerMebibyte = 1024.0;  // KiB
#endif
  return static_cast<double>(usage.ru_maxrss) / kPerMebibyte;
}

std::int64_t processId() {
  return getpid();
}

bool errorIsTerminal() {
  return isatty(STDERR_FILENO) == 1;
}

void openStandardStreams() {
  int descriptor = 0;
  do {  // each gets the lowest free number
    descriptor = open("/dev/null", O_RDWR);
  } while (descriptor >= 0 && descriptor <= STDERR_FILENO);
  if (descriptor > STDERR_FILENO) close(descriptor);
}

void ignoreWriteSignals() {
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGXFSZ, SIG_IGN);
}

void endNow(int code) {
  _exit(code);
}

}  // namespace dsorb::platform
#endif
