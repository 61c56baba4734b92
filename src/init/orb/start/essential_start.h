// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/initializer.h"

#include "init/orb/map/attempt_types.h"

#include <optional>

namespace dsorb::init_orb {

/// Poses and corners of a few frames, with a summary for the next attempt from this reference.
struct EssentialStart {
  Outcome<Reconstruction> made;
  AttemptSummary summary;
  std::optional<WaitingMotion> motion{};  ///< of a start that was judged and did not pass
};

/// Poses and corners from the essential matrix: robust adjustment of a few frames, a gate on the
/// predicted error of the direction of translation, the tracks' noise measured, corners refined by
/// aligning warped patches. Only the adjusted frames are posed.
EssentialStart startFromEssential(const ReferenceView& view, const AttemptContext& context);

}  // namespace dsorb::init_orb
