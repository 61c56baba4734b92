// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/image/frame.h"
#include "dsorb/init/initializer.h"
#include "dsorb/options/initializer.h"

#include "init/coarse/coarse_alignment.h"

#include <cmath>
#include <memory>
#include <optional>
#include <vector>

namespace dsorb::init_coarse {

/// A frame since the reference with the estimate of its time.
struct AlignedFrame {
  FramePtr frame;
  Alignment alignment;
  Alignment rotation;  ///< pure rotation that fits best
};

/// Uncertainty of one aligned frame, unit: the mean inverse depth of the good points is fixed.
struct Uncertainty {
  Matrix6d pose;                      ///< of exp(xi) T, [translation; rotation]
  std::vector<double> inverse_depth;  ///< variance a point of level 0; 0 where nothing is known
};

/// Covariance of pose and inverse depths together. Neighbouring patterns overlap, and errors of the
/// smoothed inverse depths are common to many points: all good points carry the information of a
/// few independent ones.
/// @param points level 0, trial inverse depths the ones to judge at
/// @return nothing where the frame does not determine the pose
/// @source inverse of the Gauss-Newton system with the inverse depths eliminated; effective points
///         as in init/orb/bundle/geometric_covariance
[[nodiscard]] std::optional<Uncertainty> uncertaintyOf(const AlignedFrame& tracked,
                                                       const PinholeCamera& camera,
                                                       PointLevel& points,
                                                       LevelAligner& aligner);

/// Points of all levels, finest first, with their terms in the newest frame.
struct Estimate {
  std::vector<PointLevel> levels;
  Alignment alignment;
  LevelReport finest;
  /// Photometric energy of the finest level; points that are not good count as outliers.
  [[nodiscard]] double energy() const;
};

/// The newest frame with the context of its alignment.
struct AlignmentTask {
  const Frame& frame;
  const PinholeCamera& camera;
  const CoarseOptions& options;
  LevelAligner& aligner;
};

/// Aligns the frame, coarse to fine, from the estimate's alignment and depths.
/// @param finest last level, 0: all
void alignLevels(const AlignmentTask& task, int finest, Estimate& estimate);

/// What an estimate is made for.
struct Aim {
  double enough = 1;         ///< share of the points that match; from there on one pass will do
  double energy = HUGE_VAL;  ///< it has to come down to, or else it does not matter
};

/// Aligns the frame on all levels again and again while that helps.
void converge(const AlignmentTask& task, const Aim& aim, Estimate& estimate);

/// Outcome of a contest between motions.
struct Contest {
  Estimate winner;
  double margin = 0;  ///< energy of the best one elsewhere over the winner's, less 1
};

/// Aligns the frame anew from motions in all directions over the plane of unit depth; the best of
/// them compete with the given estimate. A scene near a plane, or seen by a small motion, has
/// several motions that explain it nearly as well, and from no translation the alignment may end in
/// any of them.
/// @param rotation best pure rotation
[[nodiscard]] Contest contest(const AlignmentTask& task,
                              const Alignment& rotation,
                              const Estimate& given);

/// Direct initializer: aligns each new frame with the first one.
[[nodiscard]] std::unique_ptr<Initializer> makeCoarseInitializer(const InitializerOptions& options,
                                                                 const PinholeCamera& camera);

}  // namespace dsorb::init_coarse
