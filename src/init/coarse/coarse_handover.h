// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/init/result.h"
#include "dsorb/options/coarse.h"

#include "init/coarse/coarse_alignment.h"

#include <optional>
#include <vector>

namespace dsorb::init_coarse {

/// A frame since the reference with the estimate of its time.
struct AlignedFrame {
  FramePtr frame;
  Alignment alignment;
  Alignment rotation;  ///< pure rotation that fits best
};

/// The attempt as values: front frame the reference, back frame the newest.
struct CoarseAttempt {
  std::vector<AlignedFrame> frames;
  std::vector<PointLevel> levels;  ///< finest first, as the newest frame left them
  PinholeCamera camera;
  CoarseOptions options;
  double wrong_angle_deg = 10;  ///< from there on a direction of translation is wrong
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
[[nodiscard]] double parallaxDeg(const CoarseAttempt& attempt);

/// The best pure rotation against the estimate of the newest frame.
struct RotationTest {
  Alignment rotation;
  double motion_gain = 0;  ///< share of the energy of the rotation that translation removes
};
[[nodiscard]] RotationTest testRotation(const CoarseAttempt& attempt, LevelAligner& aligner);

/// Judges an attempt that has settled.
[[nodiscard]] Quality judge(const CoarseAttempt& attempt, LevelAligner& aligner);

/// Aligns every frame to the final inverse depths and gathers the result, scaled and checked.
[[nodiscard]] InitializationResult handOver(const CoarseAttempt& attempt,
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

/// Uncertainty of one aligned frame, unit: the mean inverse depth of the good points is fixed.
struct Uncertainty {
  Matrix6d pose;                      ///< of exp(xi) T, [translation; rotation]
  std::vector<double> inverse_depth;  ///< variance a point of level 0; 0 where nothing is known
};

/// Covariance of pose and inverse depths together. Neighbouring patterns overlap, and errors of the
/// smoothed inverse depths are common to many points: all good points carry the information of a
/// few independent ones.
/// @param points    level 0, trial inverse depths the ones to judge at
/// @param curvature of each inverse depth known from another frame [grey levels^2 unit^2]; empty:
///                  this frame alone tells them
/// @return nothing where the frame does not determine the pose
/// @source inverse of the Gauss-Newton system with the inverse depths eliminated; effective points
///         as in init/orb/geometric_covariance
[[nodiscard]] std::optional<Uncertainty> uncertaintyOf(const CoarseAttempt& attempt,
                                                       const AlignedFrame& tracked,
                                                       PointLevel& points,
                                                       const std::vector<float>& curvature,
                                                       LevelAligner& aligner);

}  // namespace dsorb::init_coarse
