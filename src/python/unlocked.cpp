// SPDX-License-Identifier: BSD-3-Clause
#include "python/unlocked.h"

#include <chrono>
#include <thread>

namespace dsorb::python {
namespace {

/// Calls into the process' one interpreter; guarded by its lock.
struct Calls {
  int under_way = 0;
  bool ending = false;
};

Calls& calls() {
  static Calls of_interpreter;
  return of_interpreter;
}

void end() {
  calls().ending = true;
  while (calls().under_way > 0) {
    const nanobind::gil_scoped_release release;
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
}

}  // namespace

Unlocked::Unlocked() {
  if (calls().ending) return;
  ++calls().under_way;
  released_.emplace();
}

Unlocked::~Unlocked() {
  if (!released_) return;
  released_.reset();
  --calls().under_way;
}

void waitAtExit() {
  nanobind::module_::import_("atexit").attr("register")(nanobind::cpp_function(end));
}

}  // namespace dsorb::python
