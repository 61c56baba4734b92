// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"
#include "dsorb/image/affine_brightness.h"
#include "dsorb/options/brightness.h"
#include "dsorb/options/tracker.h"

#include "geometry/row_motion.h"
#include "track/pose_alignment.h"
#include "track/tracking_reference.h"

#include <array>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

namespace dsorb::track {

/// Poses of two frames before the one to be tracked, relative to the tracking reference; the elder
/// is known only together with the younger.
struct MotionHistory {
  std::optional<TimedPose> previous;
  std::optional<TimedPose> before;  ///< the previous frame

  /// Appends the pose of a new frame, unless it repeats the one before: of the motion it tells
  /// nothing.
  void push(const TimedPose& newest);
  /// This history relative to another reference frame.
  [[nodiscard]] MotionHistory relativeTo(const SE3& T_new_old) const;
};

/// Poses reference -> new frame worth trying, most likely first: constant, double and half motion,
/// no motion since the previous frame, no motion since the reference, and constant motion times one
/// of 26 small rotations (single-axis ones first). With no frame before the previous one the motion
/// counts as none; with no previous frame identity is all.
/// @param time of the new frame [s]
/// @source front end of DSO as published, but for times: constant is the velocity
[[nodiscard]] std::vector<SE3> motionGuesses(const MotionHistory& history, double time);

/// Grey levels of the reference's points and of the places where a frame sees them, compared as
/// distributions: the n-th smallest here with the n-th smallest there. Unlike differences point by
/// point that hardly depends on the pose, so a guess of it is enough.
class GreyComparison {
 public:
  /// @param T_cur_ref roughly
  GreyComparison(const TrackingReference& reference, const Frame& frame, const SE3& T_cur_ref);

  /// Gain and offset that map one distribution to the other where neither is clipped.
  /// @return nullopt where too little is left or its contrast is too low
  [[nodiscard]] std::optional<BrightnessTransfer> transfer() const;
  /// Root mean square by which a transfer misses the frame's distribution, over its standard
  /// deviation; with a wrong gain about the relative error of that [-]. Infinite without contrast.
  [[nodiscard]] double misfit(const BrightnessTransfer& transfer) const;
  /// Grey level at which the frame is clipped; infinite where it is not.
  [[nodiscard]] float ceiling() const { return ceiling_; }

 private:
  std::vector<float> reference_;  // sorted
  std::vector<float> frame_;      // sorted
  float ceiling_ = std::numeric_limits<float>::infinity();
};

/// Mean squared image motion of the reference points, by translation alone and by the full motion.
struct FlowIndicators {
  double translation = 0;  ///< [px^2]
  double full = 0;         ///< [px^2]
};

/// Every 32nd point is projected with +t and -t. A point that passes the camera plane is left out;
/// one displacement counts at most the image diagonal.
/// @param camera of level 0, like the points
/// @source front end of DSO as published, with bounds on degenerate points
[[nodiscard]] FlowIndicators flowIndicators(const ReferencePoints& points,
                                            const PinholeCamera& camera,
                                            const SE3& T_cur_ref);

constexpr int kTrackingLevels = 5;  ///< levels a pyramid has at most

/// RMSE by pyramid level [grey levels]; NaN where unset.
using LevelRmse = std::array<double, kTrackingLevels>;
constexpr LevelRmse kUnsetRmse = {std::numeric_limits<double>::quiet_NaN(),
                                  std::numeric_limits<double>::quiet_NaN(),
                                  std::numeric_limits<double>::quiet_NaN(),
                                  std::numeric_limits<double>::quiet_NaN(),
                                  std::numeric_limits<double>::quiet_NaN()};

/// What is known before a frame is tracked.
struct TrackingStart {
  std::vector<SE3> guesses;    ///< T_cur_ref, most likely first; not empty
  AffineBrightness affine;     ///< of the previous frame
  double previous_rmse = 100;  ///< level 0 of the previous frame [grey levels]
  /// Largest change of the log gain a since the previous frame that the grey levels need not show;
  /// a larger one they must show, but for this share [-].
  double max_gain_step = std::numeric_limits<double>::infinity();
  /// T_cur_ref of the frames before, the nearest first: they tell the motion while the rows
  /// of a rolling shutter are read.
  std::vector<TimedPose> recent{};
  /// Standard deviation of the velocity that the parabola through the frame and two of them has
  /// while its rows are read [unit/s; rad/s].
  Vector6d velocity_sigma = Vector6d::Zero();
};

enum class TrackingFailure {
  kNone,
  kBlank,          ///< the frame shows nothing
  kDiverged,       ///< non-finite, or worse than earlier hypotheses on some level
  kBrightness,     ///< a gain that the grey levels do not show
  kTooFewInside,   ///< too few reference points project into the frame
  kLargeResidual,  ///< the best hypothesis fits badly
};

struct TrackingResult {
  TrackingFailure failure =
      TrackingFailure::kDiverged;  ///< of the first hypothesis if none is good
  SE3 T_cur_ref;                   ///< the first guess if none is good
  RowMotion motion;                ///< while the rows of a rolling shutter are read
  AffineBrightness affine;
  std::optional<Matrix6d> covariance;  ///< of exp(xi) * T_cur_ref, [translation; rotation]
  LevelRmse rmse = kUnsetRmse;         ///< lowest of the good hypotheses
  FlowIndicators flow;
  double inside_fraction = 0;  ///< level 0
  int hypotheses_tried = 0;

  [[nodiscard]] bool good() const { return failure == TrackingFailure::kNone; }
};

/// Coarse-to-fine pose and brightness of a frame against a reference with known inverse depths.
/// The result of `track` depends on the reference and the arguments alone.
/// @source Engel et al., DSO, arXiv:1607.02565, section 3.1; front end of DSO as published
class Tracker {
 public:
  /// @param compare_grey whether distributions of grey levels give and support a gain
  explicit Tracker(const TrackerOptions& options,
                   BrightnessModel brightness = {},
                   bool compare_grey = true)
      : options_(options),
        brightness_(brightness),
        compare_grey_(compare_grey),
        alignment_(brightness) {}

  /// Later frames are tracked against it; they are images of its camera.
  void setReference(TrackingReference reference) { reference_ = std::move(reference); }
  [[nodiscard]] const TrackingReference& reference() const { return reference_; }

  /// Tries the guesses one by one until one fits nearly as well as the previous frame did.
  /// @throws std::logic_error without a reference
  [[nodiscard]] TrackingResult track(const Frame& frame, const TrackingStart& start);

 private:
  /// One hypothesis from the coarsest level to the finest.
  struct Descent {
    AlignmentState state;
    TrackingFailure failure = TrackingFailure::kNone;
    LevelRmse rmse = kUnsetRmse;
    double noise = 0;         ///< LevelResult::noise of level 0
    PoseEquations equations;  ///< of the finest level reached
    double inside_fraction = 0;
  };
  [[nodiscard]] Descent descend(const Frame& frame,
                                const AlignmentState& start,
                                const TrackingStart& known,
                                const LevelRmse& bounds);
  /// All hypotheses of the pose, from one brightness.
  void search(const Frame& frame,
              const TrackingStart& start,
              const AffineBrightness& affine,
              TrackingResult& best);
  [[nodiscard]] std::vector<AffineBrightness> brightnessGuesses(const Frame& frame,
                                                                const TrackingStart& start,
                                                                const GreyComparison& grey) const;
  [[nodiscard]] BrightnessTransfer transferTo(const Frame& frame,
                                              const AffineBrightness& affine) const;
  [[nodiscard]] bool isSupported(const AlignmentState& state,
                                 const Frame& frame,
                                 const TrackingStart& start) const;

  TrackerOptions options_;
  BrightnessModel brightness_;
  bool compare_grey_;
  TrackingReference reference_;
  PoseAlignment alignment_;
  float ceiling_ = 0;  // at which the frame that is tracked is clipped [grey levels]
};

}  // namespace dsorb::track
