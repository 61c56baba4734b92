// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <nanobind/nanobind.h>

#include <optional>

namespace dsorb::python {

/// While it lives other threads of the interpreter run. Where the interpreter ends it would end a
/// thread that wants the lock back in the middle of C++, which aborts the process: the end waits
/// for calls that are under way, and calls that come later keep the lock.
class Unlocked {
 public:
  Unlocked();
  ~Unlocked();
  Unlocked(const Unlocked&) = delete;
  Unlocked& operator=(const Unlocked&) = delete;

 private:
  std::optional<nanobind::gil_scoped_release> released_;
};

/// Has the end of the interpreter wait for calls.
void waitAtExit();

}  // namespace dsorb::python
