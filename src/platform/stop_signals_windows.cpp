// SPDX-License-Identifier: BSD-3-Clause
#ifdef _WIN32
#include "platform/stop_signals.h"

#include <windows.h>

#include <atomic>

namespace dsorb::platform {
namespace {

std::atomic<HANDLE> came{nullptr};  // a handler of this system has no argument of ours

BOOL WINAPI onControl(DWORD /*kind*/) {
  const HANDLE event = came;
  return event != nullptr && SetEvent(event) != 0 ? TRUE : FALSE;
}

}  // namespace

struct StopSignals::Set {
  HANDLE event = CreateEventW(nullptr, FALSE, FALSE, nullptr);
};

StopSignals::StopSignals() : set_(std::make_unique<Set>()) {
  came = set_->event;
  SetConsoleCtrlHandler(&onControl, TRUE);
}

StopSignals::~StopSignals() {
  SetConsoleCtrlHandler(&onControl, FALSE);
  came = nullptr;
  CloseHandle(set_->event);
}

void StopSignals::wait() {
  WaitForSingleObject(set_->event, INFINITE);
}

void StopSignals::wake(std::thread& /*waiting*/) {
  SetEvent(set_->event);
}

void StopSignals::letThrough() {
  SetConsoleCtrlHandler(&onControl, FALSE);
}

}  // namespace dsorb::platform
#endif
