// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <thread>

namespace dsorb::platform {

/// Ctrl-C and what else asks a program to stop, as something that a thread waits for: no handler of
/// the program runs. Make it before any thread is started: threads inherit what is blocked.
class StopSignals {
 public:
  StopSignals();
  ~StopSignals();
  StopSignals(const StopSignals&) = delete;
  StopSignals& operator=(const StopSignals&) = delete;

  /// Returns when one came, or after wake().
  void wait();
  /// Ends the wait() of a thread; one that comes to it later does not wait.
  void wake(std::thread& waiting);
  /// Forgets those that came at once with the one before, as timeout(1) sends them to the program
  /// and to its group; for the calling thread the next one ends the program as usual.
  void letThrough();

 private:
  struct Set;
  std::unique_ptr<Set> set_;
};

}  // namespace dsorb::platform
