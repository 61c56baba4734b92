// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/init/result.h"
#include "dsorb/options/coarse.h"

#include "init/coarse/coarse_alignment.h"

#include <vector>

namespace dsorb::init_coarse {

/// A frame since the reference with the estimate of its time.
struct TrackedFrame {
  FramePtr frame;
  Alignment alignment;
  Alignment rotation;  ///< pure rotation that fits best
};

/// The attempt as values: front frame the reference, back frame the newest.
struct Attempt {
  std::vector<TrackedFrame> frames;
  std::vector<PointLevel> levels;  ///< finest first, as the newest frame left them
  PinholeCamera camera;
  CoarseOptions options;
  int seed = 1;
};

/// Whether the newest frame is a fit end of the attempt.
struct Quality {
  InitReason reason = InitReason::kDone;  ///< kDone, or what is missing
  double parallax_deg = 0;                ///< median, rotation-compensated
  double motion_gain = 0;     ///< share of the energy of a pure rotation that translation removes
  double relative_sigma = 0;  ///< median of the good points of level 0
  double inlier_share = 0;    ///< of the points of level 0 in view
  double visible_share = 0;   ///< points of level 0 in view and fit for tracking
  double residual_rms = 0;    ///< [grey levels]
  double rival_margin = 0;    ///< energy of the best motion elsewhere over its own, less 1
};

/// Median angle between the rays to the good points from the reference and the newest frame [deg].
[[nodiscard]] double parallaxDeg(const Attempt& attempt);

/// The best pure rotation against the estimate of the newest frame.
struct RotationTest {
  Alignment rotation;
  double motion_gain = 0;  ///< share of the energy of the rotation that translation removes
};
[[nodiscard]] RotationTest testRotation(const Attempt& attempt, LevelAligner& aligner);

/// Judges an attempt that has settled.
[[nodiscard]] Quality judge(const Attempt& attempt, LevelAligner& aligner);

/// Aligns every frame to the final inverse depths and gathers the result, scaled and checked.
[[nodiscard]] InitializationResult handOver(const Attempt& attempt,
                                            const Quality& quality,
                                            LevelAligner& aligner);

/// Frame brightness as the result has it, with the exposure ratio taken out of the gain.
[[nodiscard]] AffineBrightness relativeBrightness(const Frame& reference,
                                                  const Frame& frame,
                                                  const Alignment& alignment);

/// Log of the ratio of exposures, new to reference; 0 when one is unknown.
[[nodiscard]] double logExposureRatio(const Frame& reference, const Frame& frame);

/// View of one level of a frame.
[[nodiscard]] LevelView viewOf(const Frame& frame, const PinholeCamera& camera, int level);

}  // namespace dsorb::init_coarse
