// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/frame.h"
#include "dsorb/init/report.h"

#include "init/orb/tracks/corner_tracks.h"

#include <optional>
#include <vector>

namespace dsorb::init_orb {

/// Summary of the latest attempt from a reference, which tells when the next one is worth its time.
struct AttemptSummary {
  InitReason reason = InitReason::kSettling;  ///< why it did not succeed
  double rotation_residual = 0;               ///< median rotation-compensated flow [px]
  double direction_sigma_deg = 0;             ///< predicted error of the direction; 0: not known
  double parallax_deg = 0;                    ///< median angle; 0: not known
  int skipped = 0;                            ///< frames since then
  bool tried = false;                         ///< with this frame: it took its time
};

/// Input of an attempt: frames and tracks since one reference.
struct ReferenceView {
  std::vector<FramePtr> frames;        ///< the reference first
  CornerTracks tracks;                 ///< one entry a frame
  AttemptSummary last;                 ///< the attempt before
  std::optional<bool> optical_flow{};  ///< in place of descriptors, where there is a choice
};

}  // namespace dsorb::init_orb
