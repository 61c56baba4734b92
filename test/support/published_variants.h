// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#ifdef DSORB_WITH_PUBLISHED
#include "dsorb/published/registration.h"

namespace dsorb {

/// Tests of a program know the published variants before the first parameter is drawn.
inline const bool kPublishedKnown = [] {
  published::registerInitializers();
  return true;
}();

}  // namespace dsorb
#endif
