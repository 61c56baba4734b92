// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <chrono>
#include <utility>

namespace dsorb {

/// Calls a function and adds the wall time it takes to a counter, also where it throws. Times are
/// reported, nothing decides by them.
/// @param seconds the counter [s]
/// @return        what the function returns
template <typename Function>
decltype(auto) timed(double& seconds, Function&& function) {
  struct Stopwatch {
    ~Stopwatch() {
      seconds += std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    }
    double& seconds;
    std::chrono::steady_clock::time_point start = std::chrono::steady_clock::now();
  };
  const Stopwatch stopwatch{seconds};
  return std::forward<Function>(function)();
}

}  // namespace dsorb
