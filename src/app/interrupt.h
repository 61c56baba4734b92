// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <csignal>

namespace dsorb::app {

/// Turns the first Ctrl-C (SIGINT) or SIGTERM into a flag that the program polls: the signals are
/// blocked and no handler runs. A second one ends the program as usual. To be constructed before
/// any thread is started, because threads inherit the mask of blocked signals.
class Interrupt {
 public:
  Interrupt();

  /// Whether a signal has arrived. From then on further ones have their usual effect.
  [[nodiscard]] bool requested();

 private:
  sigset_t signals_;
  bool requested_ = false;
};

}  // namespace dsorb::app
