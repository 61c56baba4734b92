// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "synthetic/sequence.h"

namespace dsorb {

/// First and fifth frame of a rendered room, 320x240.
struct TwoRoomViews {
  PinholeCamera camera;
  FramePtr reference;
  FramePtr frame;
  SE3 T_cur_ref;
};

inline TwoRoomViews twoRoomViews() {
  synthetic::SequenceOptions options;
  options.kind = synthetic::SequenceKind::kRoom;
  options.length = 5;
  options.width = 320;
  options.height = 240;
  const synthetic::SyntheticSequence sequence(options);
  return {sequence.camera(),
          sequence.framePtr(0),
          sequence.framePtr(4),
          sequence.pose(4).inverse() * sequence.pose(0)};
}

}  // namespace dsorb
