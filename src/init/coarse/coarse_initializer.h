// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/image/frame.h"
#include "dsorb/init/initializer.h"
#include "dsorb/init/result.h"
#include "dsorb/options/coarse.h"

#include "base/parallel.h"
#include "image/frame_check.h"
#include "init/coarse/coarse_alignment.h"
#include "init/reset_log.h"

#include <cmath>
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

struct RotationMatch {
  Alignment rotation;
  bool matches = false;  ///< the images do, nearly everywhere in view: it may well be the motion
};

/// Finds the pure rotation that explains a frame best, on the coarsest level alone: from the best
/// of the given starts, or, where the images do not match from there, from a grid of rotations
/// around it.
class RotationSearch {
 public:
  explicit RotationSearch(const CoarseOptions& options) : aligner_(options) {}

  /// @param points coarsest level of the reference
  void setReference(const PointLevel& points) { points_ = points; }

  /// @param starts at least one; their translations are left out
  [[nodiscard]] RotationMatch find(const LevelView& coarsest, const std::vector<Alignment>& starts);

 private:
  /// Energy at an alignment; points out of view or far off count as outliers.
  double energy(const LevelView& view, const Alignment& alignment);
  Alignment best(const LevelView& view, const std::vector<Alignment>& candidates);
  /// @return share of the points in view that match
  double refine(const LevelView& view, Alignment& alignment);

  LevelAligner aligner_;
  PointLevel points_;
};

/// Direct initializer: aligns each new frame with the first one, pose, brightness and the inverse
/// depths of the first frame's points together, coarse to fine. A prior holds translation and
/// depths until the images explain a motion well enough ("snap"); after some more frames it hands
/// over.
/// @source front end of DSO as published with Engel et al., arXiv:1607.02565
class CoarseInitializer : public Initializer {
 public:
  CoarseInitializer(const InitializerOptions& options, const PinholeCamera& camera);

  [[nodiscard]] InitStep addFrame(FramePtr frame) override;
  void reset() override;

 private:
  /// Makes the frame the first one.
  /// @return false when it has too few points
  bool setReference(const FramePtr& frame);
  /// Aligns the newest frame on all levels; the report is that of the finest.
  LevelReport track(const FramePtr& frame);
  /// The estimate of the last frame, and what it becomes by the last relative motion.
  [[nodiscard]] std::vector<Alignment> startValues(const Frame& frame,
                                                   const Alignment& last,
                                                   const SE3& motion) const;
  /// The start that fits the coarsest level better.
  [[nodiscard]] Alignment bestStart(const Frame& frame, const std::vector<Alignment>& starts);
  /// Brings the prior back where a pure rotation explains the newest frame nearly as well.
  void confirmSnap();
  [[nodiscard]] bool waitsForParallax() const;
  InitStep assess(const LevelReport& finest);
  /// Lets motions in other directions compete with the estimate and takes over the best.
  /// @return margin of the contest
  double challenge(const LevelReport& finest);
  InitStep conclude(const LevelReport& finest);
  /// Drops everything before the frame. @param lost everything is wrong, not just old
  InitStep startOver(const FramePtr& frame, InitReason reason, bool lost);

  InitializerOptions options_;
  PinholeCamera camera_;
  TaskArena arena_;
  FrameCheck frame_check_;
  LevelAligner aligner_;
  RotationSearch rotation_search_;

  CoarseAttempt attempt_;
  StageClock clock_;
  int snapped_since_ = 0;    ///< frames tracked up to the one that snapped, 0: not yet
  int tracked_ = 0;          ///< frames since the reference
  int refusals_ = 0;         ///< frames in a row that settled in poor quality
  double inlier_share_ = 0;  ///< of the newest frame
  bool done_ = false;
  ResetLog resets_;
  SE3 last_motion_;  ///< from the frame before the newest to the newest
};

}  // namespace dsorb::init_coarse
