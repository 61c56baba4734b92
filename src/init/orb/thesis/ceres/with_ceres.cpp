// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/thesis/with_ceres.h"

namespace dsorb::init_orb {

bool builtWithCeres() {
  return true;
}

}  // namespace dsorb::init_orb
