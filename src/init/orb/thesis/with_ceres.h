// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace dsorb::init_orb {

/// Whether this build has Ceres and OpenCV's optical flow (DSORB_WITH_CERES), which [Gladkova]'s
/// variants and `orb-matching` need.
[[nodiscard]] bool builtWithCeres();

}  // namespace dsorb::init_orb
