// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "place/keyframe_store.h"
#include "place/recognition.h"

#include <vector>

namespace dsorb::place {

/// Where keyframes of a segment are when its loops are closed: S_new_old of each, in the order of
/// KeyframeStore::inSegment(). Empty: no loop is open by more than its uncertainty, or a build
/// without Ceres.
[[nodiscard]] std::vector<Similarity> closeLoops(const KeyframeStore& store,
                                                 int segment,
                                                 const std::vector<Link>& links,
                                                 int num_threads);

}  // namespace dsorb::place
