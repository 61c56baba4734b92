// SPDX-License-Identifier: BSD-3-Clause
#include "app/interrupt.h"

#include <ctime>

namespace dsorb::app {

Interrupt::Interrupt() : signals_() {
  sigemptyset(&signals_);
  sigaddset(&signals_, SIGINT);
  sigaddset(&signals_, SIGTERM);
  pthread_sigmask(SIG_BLOCK, &signals_, nullptr);
}

bool Interrupt::requested() {
  if (requested_) return true;
  const timespec no_wait{0, 0};
  requested_ = sigtimedwait(&signals_, nullptr, &no_wait) > 0;
  if (requested_) pthread_sigmask(SIG_UNBLOCK, &signals_, nullptr);
  return requested_;
}

}  // namespace dsorb::app
