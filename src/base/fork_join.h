// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#ifdef __SANITIZE_THREAD__
#include <sanitizer/tsan_interface.h>
#endif

namespace dsorb {

/// Life of a parallel call. Tells ThreadSanitizer what TBB promises but a library built without it
/// cannot show: tasks see what was written before the call, and whoever comes after the call sees
/// what tasks have written. Tasks stay unordered among each other. In other builds it does nothing.
class ForkJoin {
 public:
  /// Life of a task of the call.
  class Task {
   public:
    explicit Task(ForkJoin& call) : call_(call) { acquire(call_.fork_); }
    ~Task() { release(call_.join_); }
    Task(const Task&) = delete;
    Task& operator=(const Task&) = delete;

   private:
    ForkJoin& call_;
  };

  ForkJoin() { release(fork_); }
  ~ForkJoin() { acquire(join_); }
  ForkJoin(const ForkJoin&) = delete;
  ForkJoin& operator=(const ForkJoin&) = delete;

 private:
#ifdef __SANITIZE_THREAD__
  static void acquire(char& event) {
    __tsan_acquire(&event);
  }
  static void release(char& event) {
    __tsan_release(&event);
  }
#else
  static void acquire(char& /*event*/) {}
  static void release(char& /*event*/) {}
#endif

  char fork_ = 0;
  char join_ = 0;
};

}  // namespace dsorb
