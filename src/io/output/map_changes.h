// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/odometry/observer.h"

#include <map>
#include <vector>

namespace dsorb::io {

/// What became of a run's segments after they were told: joins and loops.
struct MapChanges {
  std::vector<SegmentsJoined> joins;
  std::vector<LoopsClosed> loops;
  std::map<FrameId, Similarity> moved;  ///< by keyframe: S_new_old of loops, after the joins

  void add(const SegmentsJoined& joined) { joins.push_back(joined); }
  void add(const LoopsClosed& closed) {
    loops.push_back(closed);
    for (const KeyframeMoved& keyframe : closed.moved) moved[keyframe.id] = keyframe.S_new_old;
  }
  [[nodiscard]] bool empty() const { return joins.empty() && loops.empty(); }

  /// The segment that has become of one.
  [[nodiscard]] int segmentOf(int segment) const {
    for (const SegmentsJoined& joined : joins) {
      if (joined.segment == segment) segment = joined.into;
    }
    return segment;
  }
  /// World of now from the world in which something was told, around a keyframe of the segment.
  [[nodiscard]] Similarity changeOf(int segment, FrameId keyframe) const {
    Similarity change;
    for (const SegmentsJoined& joined : joins) {
      if (joined.segment != segment) continue;
      change = joined.S_into_segment * change;
      segment = joined.into;
    }
    const auto by_loops = moved.find(keyframe);
    return by_loops == moved.end() ? change : by_loops->second * change;
  }
};

}  // namespace dsorb::io
