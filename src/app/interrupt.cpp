// SPDX-License-Identifier: BSD-3-Clause
#include "app/interrupt.h"

#include "platform/process.h"

#include <chrono>
#include <utility>

namespace dsorb::app {
namespace {

// Time from a signal to the end of a program that does not end by itself; with what is written then
// it stays below a second.
constexpr std::chrono::milliseconds kPatience(500);
constexpr int kNothingToWrite = 3;  // exit code: nothing was tracked

}  // namespace

Interrupt::Interrupt() {
  watcher_ = std::thread([this] { watch(); });
}

Interrupt::~Interrupt() {
  {
    const std::lock_guard<std::mutex> lock(mutex_);
    stopping_ = true;
    // The watcher takes the signal itself, or has it blocked when it ends.
    if (!requested_) signals_.wake(watcher_);
  }
  changed_.notify_all();
  watcher_.join();
}

void Interrupt::setLastResort(LastResort last_resort) {
  const std::lock_guard<std::mutex> lock(mutex_);
  last_resort_ = std::move(last_resort);
}

void Interrupt::settle() {
  const std::lock_guard<std::mutex> lock(mutex_);
  settled_ = true;
  changed_.notify_all();
}

void Interrupt::watch() {
  signals_.wait();
  std::unique_lock<std::mutex> lock(mutex_);
  if (stopping_) return;
  requested_ = true;
  endWhenLate(lock);
}

/// Holds the lock to the end of a program that is late, so that settle() and setLastResort() cannot
/// return.
void Interrupt::endWhenLate(std::unique_lock<std::mutex>& lock) {
  const bool in_time = changed_.wait_for(lock, kPatience, [this] { return settled_ || stopping_; });
  if (!in_time) platform::endNow(last_resort_ ? last_resort_() : kNothingToWrite);
  lock.unlock();
  signals_.letThrough();
  lock.lock();
  changed_.wait(lock, [this] { return stopping_; });
}

}  // namespace dsorb::app
