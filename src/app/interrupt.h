// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <csignal>

namespace dsorb::app {

/// Turns the first Ctrl-C (SIGINT) or SIGTERM into a question that the program answers when it
/// suits: signals are blocked and asked for, no handler runs. A second one ends the program as
/// usual. Make it before any thread is started: threads inherit what is blocked.
class Interrupt {
 public:
  Interrupt();

  /// Whether a signal came; from then on further ones have their usual effect.
  [[nodiscard]] bool requested();

 private:
  sigset_t signals_;
  bool requested_ = false;
};

}  // namespace dsorb::app
