// SPDX-License-Identifier: BSD-3-Clause
#ifndef _WIN32
#include "platform/stop_signals.h"

#include <pthread.h>

#include <chrono>
#include <csignal>

namespace dsorb::platform {
namespace {

constexpr std::chrono::milliseconds kTwiceAtOnce(100);

}  // namespace

struct StopSignals::Set {
  sigset_t signals{};

  /// @return whether there was one
  [[nodiscard]] bool takePending() const {
    sigset_t pending{};
    if (sigpending(&pending) != 0) return false;
    for (const int signal : {SIGINT, SIGTERM, SIGHUP}) {
      if (sigismember(&pending, signal) != 1 || sigismember(&signals, signal) != 1) continue;
      int taken = 0;
      sigwait(&signals, &taken);
      return true;
    }
    return false;
  }
};

StopSignals::StopSignals() : set_(std::make_unique<Set>()) {
  sigemptyset(&set_->signals);
  sigaddset(&set_->signals, SIGINT);
  sigaddset(&set_->signals, SIGTERM);
  struct sigaction hangup {};  // ignored where nohup has started the program
  if (sigaction(SIGHUP, nullptr, &hangup) == 0 && hangup.sa_handler != SIG_IGN) {
    sigaddset(&set_->signals, SIGHUP);
  }
  pthread_sigmask(SIG_BLOCK, &set_->signals, nullptr);
}

StopSignals::~StopSignals() = default;

void StopSignals::wait() {
  int signal = 0;
  sigwait(&set_->signals, &signal);
}

void StopSignals::wake(std::thread& waiting) {
  pthread_kill(waiting.native_handle(), SIGINT);
}

void StopSignals::letThrough() {
  do {
    std::this_thread::sleep_for(kTwiceAtOnce);
  } while (set_->takePending());
  pthread_sigmask(SIG_UNBLOCK, &set_->signals, nullptr);
}

}  // namespace dsorb::platform
#endif
