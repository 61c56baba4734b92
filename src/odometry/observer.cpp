// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/odometry/observer.h"

namespace dsorb {

const char* name(OdometryState state) {
  switch (state) {
    case OdometryState::kInitializing:
      return "initializing";
    case OdometryState::kInitialized:
      return "initialized";
    case OdometryState::kTracked:
      return "tracked";
    case OdometryState::kLost:
      return "lost";
    case OdometryState::kMissed:
      return "missed";
  }
  return "unknown";
}

}  // namespace dsorb
