// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/frame.h"

#include "init/coarse/coarse_alignment.h"

#include <optional>
#include <vector>

namespace dsorb::init_coarse {

/// Points of all levels, finest first, with what they say of the newest frame.
struct Estimate {
  std::vector<PointLevel> levels;
  Alignment alignment;
  LevelReport finest;
  /// Photometric energy of the finest level; points that are not good count as outliers.
  [[nodiscard]] double energy() const;
};

/// The newest frame and what it takes to align it.
struct AlignmentTask {
  const Frame& frame;
  const PinholeCamera& camera;
  const CoarseOptions& options;
  LevelAligner& aligner;
};

/// Aligns the frame on all levels, coarse to fine, from the estimate's alignment and depths.
void alignLevels(const AlignmentTask& task, Estimate& estimate);

/// Tries motions along the axes, each turned so that points of unit depth stay where the rotation
/// alone has them: what tells them apart is relief, which the alignment from no translation may see
/// inside out.
/// @param rotation best pure rotation
/// @return the best estimate, when its energy is below that of the given one
[[nodiscard]] std::optional<Estimate> betterHypothesis(const AlignmentTask& task,
                                                       const Alignment& rotation,
                                                       const Estimate& given);

}  // namespace dsorb::init_coarse
