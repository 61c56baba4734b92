// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "platform/stop_signals.h"

#include <atomic>
#include <condition_variable>
#include <functional>
#include <mutex>
#include <thread>

namespace dsorb::app {

/// Turns the first Ctrl-C (SIGINT), SIGTERM or SIGHUP into a question that the program answers when
/// it suits: signals are blocked in every thread but one that waits for them, no handler runs.
/// Where the program does not come to its end soon, because it reads or computes for long, that
/// thread ends it. Once the program is about to end a second signal ends it as usual. Make it
/// before any thread is started: threads inherit what is blocked.
class Interrupt {
 public:
  /// Writes what there is. @return the exit code
  using LastResort = std::function<int()>;

  Interrupt();
  ~Interrupt();
  Interrupt(const Interrupt&) = delete;
  Interrupt& operator=(const Interrupt&) = delete;

  /// Whether a signal came.
  [[nodiscard]] bool requested() const { return requested_; }

  /// What the waiting thread does before it ends a program that is late. Empty: nothing. The
  /// program's own thread may be anywhere then.
  void setLastResort(LastResort last_resort);

  /// The program is about to end by itself: it is not late any more. Does not return where it was
  /// too late to say so.
  void settle();

 private:
  void watch();
  void endWhenLate(std::unique_lock<std::mutex>& lock);

  platform::StopSignals signals_;
  std::atomic<bool> requested_{false};
  std::mutex mutex_;
  std::condition_variable changed_;
  LastResort last_resort_;
  bool settled_ = false;
  bool stopping_ = false;
  std::thread watcher_;
};

}  // namespace dsorb::app
