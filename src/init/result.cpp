// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/init/result.h"

namespace dsorb {

const char* name(InitReason reason) {
  switch (reason) {
    case InitReason::kFirstFrame:
      return "first_frame";
    case InitReason::kTooFewPoints:
      return "too_few_points";
    case InitReason::kTooLittleParallax:
      return "too_little_parallax";
    case InitReason::kSettling:
      return "settling";
    case InitReason::kTrackingLost:
      return "tracking_lost";
    case InitReason::kDegenerateMotion:
      return "degenerate_motion";
    case InitReason::kPoorQuality:
      return "poor_quality";
    case InitReason::kTimeout:
      return "timeout";
    case InitReason::kDone:
      return "done";
  }
  return "unknown";
}

}  // namespace dsorb
