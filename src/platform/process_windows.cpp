// SPDX-License-Identifier: BSD-3-Clause
#ifdef _WIN32
#include "platform/process.h"

#include <windows.h>
// needs windows.h before it
#include <io.h>
#include <psapi.h>

#include <cstdio>
#include <cstdlib>

namespace dsorb::platform {

double peakMemory() {
  PROCESS_MEMORY_COUNTERS counters{};
  K32GetProcessMemoryInfo(GetCurrentProcess(), &counters, sizeof counters);
  return static_cast<double>(counters.PeakWorkingSetSize) / (1024.0 * 1024.0);
}

std::int64_t processId() {
  return static_cast<std::int64_t>(GetCurrentProcessId());
}

bool errorIsTerminal() {
  return _isatty(_fileno(stderr)) != 0;
}

void openStandardStreams() {}  // this system gives their numbers to no other file

void ignoreWriteSignals() {}  // there are none

void endNow(int code) {
  std::_Exit(code);
}

}  // namespace dsorb::platform
#endif
