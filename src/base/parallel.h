// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <tbb/blocked_range.h>
#include <tbb/info.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_invoke.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cstddef>
#include <memory>
#include <optional>
#include <type_traits>
#include <utility>

#ifdef __SANITIZE_THREAD__
#include <sanitizer/tsan_interface.h>
#endif

namespace dsorb {

/// The threads that somebody wants (0: all), but no more than the process may use, which a
/// container makes fewer than the machine has: TBB would print a warning.
inline int threadsInUse(int wanted) {
  const int available = tbb::info::default_concurrency();
  return wanted > 0 ? std::min(wanted, available) : available;
}

/// Threads owned by one object of the public API. Work run inside uses at most threadsInUse().
class TaskArena {
 public:
  explicit TaskArena(int num_threads)
      : arena_(std::make_unique<tbb::task_arena>(threadsInUse(num_threads))) {}

  template <typename Function>
  auto run(Function&& function) {
    return arena_->execute(std::forward<Function>(function));
  }

 private:
  std::unique_ptr<tbb::task_arena> arena_;
};

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

/// Items that a task of forEachRange() has at least, where an item takes a fraction of a
/// microsecond up to some of them: a task is then worth its start.
constexpr std::size_t kTaskGrain = 32;

/// Calls function(begin, end) on disjoint ranges that cover [0, n). Results must not depend on the
/// split. @param grain items a range has at least; 0 runs everything in one call
template <typename Function>
void forEachRange(std::size_t n, std::size_t grain, Function&& function) {
  if (grain == 0 || n <= grain) {
    if (n > 0) function(std::size_t{0}, n);
    return;
  }
  ForkJoin call;
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, n, grain),
                    [&](const tbb::blocked_range<std::size_t>& range) {
                      const ForkJoin::Task task(call);
                      function(range.begin(), range.end());
                    });
}

/// Runs two functions that share nothing they write, at the same time where threads are free.
template <typename First, typename Second>
void runBoth(First&& first, Second&& second) {
  ForkJoin call;
  tbb::parallel_invoke(
      [&] {
        const ForkJoin::Task task(call);
        first();
      },
      [&] {
        const ForkJoin::Task task(call);
        second();
      });
}

/// Sum over [begin, end) of function(begin, end, zero) -> Value; halves until a range has at most
/// `grain` items.
template <typename Value, typename Function>
struct Summation {
  Value operator()(std::size_t begin, std::size_t end) const {
    if (end - begin <= grain) return function(begin, end, zero);
    const std::size_t middle = begin + (end - begin) / 2;
    std::optional<Value> left;
    std::optional<Value> right;
    runBoth([&] { left = (*this)(begin, middle); }, [&] { right = (*this)(middle, end); });
    *left += *right;
    return std::move(*left);
  }

  std::size_t grain;
  const Value& zero;
  Function& function;
};

/// Sum over [0, n) of function(begin, end, partial) -> partial, split and added in an order that
/// depends on n and grain alone, so that the bits are the same for any number of threads.
/// @param grain items a range has at most; not 0
template <typename Value, typename Function>
Value deterministicSum(std::size_t n, std::size_t grain, const Value& zero, Function&& function) {
  if (n == 0) return zero;
  return Summation<Value, std::remove_reference_t<Function>>{grain, zero, function}(0, n);
}

}  // namespace dsorb
