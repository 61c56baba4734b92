// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <tbb/blocked_range.h>
#include <tbb/info.h>
#include <tbb/parallel_for.h>
#include <tbb/parallel_invoke.h>
#include <tbb/parallel_reduce.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cstddef>
#include <functional>
#include <memory>
#include <utility>

namespace dsorb {

/// Threads owned by one object of the public API. Work run inside uses at most `num_threads`
/// threads (0: all the machine has), never more than the machine has: TBB would print a warning.
class TaskArena {
 public:
  explicit TaskArena(int num_threads)
      : arena_(std::make_unique<tbb::task_arena>(
            num_threads > 0 ? std::min(num_threads, tbb::info::default_concurrency())
                            : int{tbb::task_arena::automatic})) {}

  template <typename Function>
  auto run(Function&& function) {
    return arena_->execute(std::forward<Function>(function));
  }

 private:
  std::unique_ptr<tbb::task_arena> arena_;
};

/// Calls function(begin, end) on disjoint ranges that cover [0, n). Results must not depend on the
/// split. @param grain items a range has at least; 0 runs everything in one call
template <typename Function>
void forEachRange(std::size_t n, std::size_t grain, Function&& function) {
  if (grain == 0 || n <= grain) {
    if (n > 0) function(std::size_t{0}, n);
    return;
  }
  tbb::parallel_for(
      tbb::blocked_range<std::size_t>(0, n, grain),
      [&](const tbb::blocked_range<std::size_t>& range) { function(range.begin(), range.end()); });
}

/// Runs two functions that share nothing they write, at the same time where threads are free.
template <typename First, typename Second>
void runBoth(First&& first, Second&& second) {
  tbb::parallel_invoke(std::forward<First>(first), std::forward<Second>(second));
}

/// Sum over [0, n) of function(begin, end, partial) -> partial, split and added in an order that
/// depends on n and grain alone, so that the bits are the same for any number of threads.
/// @param grain items a range has at most; not 0
template <typename Value, typename Function>
Value deterministicSum(std::size_t n, std::size_t grain, const Value& zero, Function&& function) {
  return tbb::parallel_deterministic_reduce(
      tbb::blocked_range<std::size_t>(0, n, grain),
      zero,
      [&](const tbb::blocked_range<std::size_t>& range, Value partial) {
        return function(range.begin(), range.end(), std::move(partial));
      },
      [](Value left, const Value& right) {
        left += right;
        return left;
      });
}

}  // namespace dsorb
