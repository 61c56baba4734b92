// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/start/informed_motion.h"

#include "init/orb/bundle/corner_polish.h"
#include "init/orb/bundle/geometric_covariance.h"
#include "init/orb/bundle/robust_adjustment.h"
#include "init/orb/map/map_scale.h"
#include "init/orb/start/motion_candidates.h"
#include "init/orb/start/start_gate.h"
#include "init/orb/two_view/essential_motion.h"
#include "init/orb/two_view/model_competition.h"
#include "init/orb/two_view/rotation_only.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace dsorb::init_orb {
namespace {

constexpr int kMinTracks = 50;  // of a reference, before an attempt
constexpr double kMinRotationResidual =
    0.5;                                // median that a rotation leaves; less: no parallax [px]
constexpr double kMinTrackNoise = 0.5;  // where models compete, however well the tracks fit [px]
/// An attempt is left out where the last one from this reference, extrapolated by the growth of the
/// parallax, misses the gate by more than this factor.
constexpr double kRetryMargin = 1.25;
constexpr int kMaxSkippedFrames = 2;  // but so many times in a row at most
constexpr int kNoiseRounds = 3;       // of measuring the tracks' noise from the residuals

/// One attempt on its way from tracks to a map.
class InformedAttempt {
 public:
  InformedAttempt(const ReferenceView& view, const AttemptContext& context, Attempt& attempt)
      : view_(view),
        context_(context),
        gate_(context.options.orb.gate),
        attempt_(attempt),
        matches_(view.tracks.matchesTo(view.tracks.frames() - 1)) {}

  /// @return why there is no map, or kDone
  InitReason run();

 private:
  [[nodiscard]] bool worthTheTime() const;
  InitReason choosePlane(double essential_gric);
  InitReason refine();
  void detail(const char* key, double value) { attempt_.report.details.emplace_back(key, value); }
  [[nodiscard]] double trackNoise() const { return std::max(kMinTrackNoise, motion_->noise); }

  const ReferenceView& view_;
  const AttemptContext& context_;
  const GateOptions& gate_;
  Attempt& attempt_;
  Matches matches_;
  RotationFit rotation_;
  std::optional<EssentialMotion> motion_;
  std::optional<MotionCandidate> candidate_;
  DisplacementModel model_ = DisplacementModel::kEssential;
};

/// Whether enough has changed since the last attempt from this reference: the predicted error
/// falls, and the parallax grows, with what a rotation leaves of the displacements.
bool InformedAttempt::worthTheTime() const {
  const MotionEvidence& last = view_.evidence;
  if (last.direction_sigma_deg == 0 || last.skipped >= kMaxSkippedFrames) return true;
  const double growth = attempt_.evidence.rotation_residual / last.rotation_residual;
  const double better = kRetryMargin * growth;
  const double sigma = last.direction_sigma_deg / better;
  return sigma < gate_.max_direction_sigma_deg &&
         better * last.parallax_deg > neededParallaxDeg(gate_, sigma);
}

InitReason InformedAttempt::run() {
  if (static_cast<int>(matches_.size()) < kMinTracks) return InitReason::kTooFewPoints;
  StageClock& clock = context_.clock;
  rotation_ = clock.time("rotation", [&] { return fitRotation(matches_, context_.camera); });
  attempt_.evidence.rotation_residual = rotation_.median_residual;
  if (rotation_.median_residual < kMinRotationResidual) {
    return InitReason::kTooLittleParallax;
  }
  if (!worthTheTime()) {
    attempt_.evidence = view_.evidence;
    ++attempt_.evidence.skipped;
    return view_.evidence.reason;
  }
  attempt_.evidence.tried = true;
  motion_ = clock.time("essential", [&] {
    return estimateEssentialMotion(matches_, context_.camera, context_.seed());
  });
  if (!motion_) return InitReason::kPoorQuality;
  std::vector<double> errors = epipolarDistances(motion_->T_target_ref, matches_, context_.camera);
  for (double& error : errors) error *= error;
  const double essential_gric = gric(DisplacementModel::kEssential, errors, trackNoise());
  errors = rotationSampsonErrors(rotation_.R_target_ref, matches_, context_.camera);
  if (gric(DisplacementModel::kRotation, errors, trackNoise()) < essential_gric) {
    return InitReason::kTooLittleParallax;
  }
  candidate_ = clock.time("geometric", [&] { return makeCandidate(view_, *motion_, context_); });
  if (!candidate_) return InitReason::kTooFewPoints;
  const GateReport gate = clock.time("gate", [&] {
    return judgeStart(candidate_->map,
                      context_.camera,
                      context_.options.orb,
                      static_cast<int>(matches_.size()),
                      candidate_->front_share);
  });
  attempt_.evidence.direction_sigma_deg = gate.direction_sigma_deg;
  attempt_.evidence.parallax_deg = gate.parallax_deg;
  detail("fitted_sigma_deg", gate.fitted_sigma_deg);
  if (gate.reason != InitReason::kDone) return gate.reason;
  const InitReason reason = clock.time("planes", [&] { return choosePlane(essential_gric); });
  if (reason != InitReason::kDone) return reason;
  attempt_.report.median_parallax_deg = gate.parallax_deg;
  return refine();
}

/// Where a homography explains the matches better, both motions of the plane are tried.
InitReason InformedAttempt::choosePlane(double essential_gric) {
  const auto H = estimateHomography(matches_, kRansacThreshold, context_.seed());
  if (!H) return InitReason::kDone;
  const double homography_gric =
      gric(DisplacementModel::kHomography, homographySampsonErrors(*H, matches_), trackNoise());
  detail("gric_homography_over_essential", homography_gric / essential_gric);
  if (homography_gric >= essential_gric) return InitReason::kDone;
  model_ = DisplacementModel::kHomography;
  const double ratio = competeOverFrames(
      view_, planeMotions(*H, matches_, context_.camera, kRansacThreshold), context_, *candidate_);
  detail("second_motion_cost_ratio", std::min(ratio, kMinPlaneCostRatio * 1000));
  return ratio < kMinPlaneCostRatio ? InitReason::kDegenerateMotion : InitReason::kDone;
}

/// Measures noise and corners, drops what is behind the camera, sets scale and covariances.
InitReason InformedAttempt::refine() {
  attempt_.report.model = name(model_);
  attempt_.report.inlier_ratio =
      static_cast<double>(motion_->inliers) / static_cast<double>(matches_.size());
  detail("tracks", static_cast<double>(matches_.size()));
  detail("model_inliers", motion_->inliers);
  detail("rotation_residual_px", rotation_.median_residual);
  detail("direction_sigma_deg", attempt_.evidence.direction_sigma_deg);
  detail("front_share", candidate_->front_share);

  const PinholeCamera& camera = context_.camera;
  InitialMap& map = attempt_.map.emplace(std::move(candidate_->map));
  GeometricOptions adjusted = context_.clock.time("geometric", [&] {
    return adjustToNoise(map, camera, context_.options.orb.geometric, kNoiseRounds);
  });
  detail("track_noise", adjusted.sigma);
  const PolishReport polish = context_.clock.time("polish", [&] {
    return polishCorners(map, camera, adjusted, context_.options.orb.polish_rounds);
  });
  detail("polished", polish.accepted ? 1 : 0);
  detail("polish_first_rms", polish.first_rms);
  detail("polish_last_rms", polish.last_rms);
  detail("polish_turn_deg", polish.turn_deg);
  if (!polish.fits) return InitReason::kPoorQuality;
  if (polish.accepted) adjusted = polish.adjusted;

  std::vector<char> behind(map.corners.size(), 0);
  for (std::size_t i = 0; i < behind.size(); ++i) {
    behind[i] = map.corners[i].inverse_depth > 0 ? 0 : 1;
  }
  removeCorners(map, behind);
  // What the gate asked for must not have gone since: patches that do not match say as much.
  if (static_cast<double>(map.corners.size()) <
      std::max(static_cast<double>(gate_.min_points),
               gate_.min_track_share * static_cast<double>(matches_.size()))) {
    return InitReason::kPoorQuality;
  }
  if (!normalizeCornerScale(map)) return InitReason::kPoorQuality;
  attempt_.report.residual_rms = medianError(map, camera);
  const double factor =
      context_.clock.time("covariance", [&] { return setCovariances(map, camera, adjusted); });
  detail("variance_factor", factor);
  detail("clustered_factor", map.clustered_factor);
  return std::isfinite(factor) ? InitReason::kDone : InitReason::kPoorQuality;
}

}  // namespace

bool estimateInformedMotion(const ReferenceView& view,
                            const AttemptContext& context,
                            Attempt& attempt) {
  attempt.reason = InformedAttempt(view, context, attempt).run();
  attempt.evidence.reason = attempt.reason;
  return attempt.reason == InitReason::kDone;
}

}  // namespace dsorb::init_orb
