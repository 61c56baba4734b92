// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/start/essential_start.h"

#include "base/median.h"
#include "init/orb/bundle/corner_refinement.h"
#include "init/orb/bundle/frame_motions.h"
#include "init/orb/bundle/geometric_covariance.h"
#include "init/orb/bundle/map_assembly.h"
#include "init/orb/bundle/readout_score.h"
#include "init/orb/bundle/robust_adjustment.h"
#include "init/orb/start/known_depth_start.h"
#include "init/orb/start/motion_candidates.h"
#include "init/orb/start/rival_motions.h"
#include "init/orb/start/start_gate.h"
#include "init/orb/two_view/essential_motion.h"
#include "init/orb/two_view/model_selection.h"
#include "init/orb/two_view/rotation_only.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

namespace dsorb::init_orb {
namespace {

constexpr int kMinTracks = 50;                // of a reference, before an attempt
constexpr double kMinRotationResidual = 0.5;  // rotation-compensated flow; less: no parallax [px]
/// Least noise of the tracks in the competition of models [px]. With the measured 0.1 px a rotation
/// never wins on real images: docs/experiments.md, "What did not help".
constexpr double kMinTrackNoise = 0.5;
/// An attempt is left out where the last one from this reference, extrapolated by the growth of the
/// parallax, misses the gate by more than this factor.
constexpr double kRetryMargin = 1.5;
constexpr int kMaxSkippedFrames = 1;  // but so many times in a row at most
/// Least noise of a match in the likelihood of motions elsewhere [px].
constexpr double kMinMatchNoise = 0.05;
/// Median epipolar distance of a motion from known depths over that of the best motion, and the
/// least one that counts [px].
constexpr double kMaxMisfit = 2;
constexpr double kMinMisfit = 0.05;
/// Of the deviations of known depths that are not used otherwise: beyond it they give no scale.
constexpr double kMaxInflation = 2;
constexpr double kMaxCostRatio = 1000;  // of a plane's motions: files hold no infinity
constexpr int kNoiseRounds =
    3;  // of measuring the noise; docs/experiments.md, "Noise of the tracks"

/// Whether enough has changed since the last attempt from this reference: the predicted errors fall
/// as the rotation-compensated flow grows.
bool worthTheTime(const AttemptSummary& last, double rotation_residual, const GateOptions& gate) {
  if (!last.gate || last.skipped >= kMaxSkippedFrames) return true;
  return errorsPass(*last.gate, kRetryMargin * rotation_residual / last.rotation_residual, gate);
}

/// A motion between two views, and how well its model explains the matches.
struct SelectedMotion {
  EssentialMotion motion;
  double noise = 0;  ///< of a match [px]
  double gric = 0;
};

/// The essential matrix's motion, unless a rotation explains the matches better.
Outcome<SelectedMotion> selectMotion(const Matches& matches,
                                     const RotationFit& rotation,
                                     const AttemptContext& context) {
  auto motion = context.clock.time("essential", [&] {
    return estimateEssentialMotion(matches, context.camera, context.seed());
  });
  if (!motion) return InitReason::kPoorQuality;
  SelectedMotion selected{std::move(*motion), 0, 0};
  selected.noise = std::max(kMinTrackNoise, selected.motion.noise);
  std::vector<double> errors =
      epipolarDistances(selected.motion.T_cur_ref, matches, context.camera);
  for (double& error : errors) error *= error;
  selected.gric = gric(DisplacementModel::kEssential, errors, selected.noise);
  errors = rotationSampsonErrors(rotation.R_cur_ref, matches, context.camera);
  if (gric(DisplacementModel::kRotation, errors, selected.noise) < selected.gric) {
    return InitReason::kTooLittleParallax;
  }
  return selected;
}

/// The best motion after the motions of a plane have been tried as well.
struct PlaneComparison {
  MotionCandidate best;
  DisplacementModel model = DisplacementModel::kEssential;
  std::optional<double> homography_gric;  ///< over that of the essential matrix
  std::optional<double> second_cost;      ///< of the best really different motion, over the best's
};

/// Where a homography explains the matches better, both motions of the plane are tried.
void comparePlane(const SelectedMotion& selected,
                  const ReferenceView& view,
                  const Matches& matches,
                  const AttemptContext& context,
                  PlaneComparison& compared) {
  const auto H = estimateHomography(matches, kRansacThreshold, context.seed());
  if (!H) return;
  const double homography_gric =
      gric(DisplacementModel::kHomography, homographySampsonErrors(*H, matches), selected.noise);
  compared.homography_gric = homography_gric / selected.gric;
  if (homography_gric >= selected.gric) return;
  compared.model = DisplacementModel::kHomography;
  const double ratio = competeOverFrames(
      view, planeMotions(*H, matches, context.camera, kRansacThreshold), context, compared.best);
  compared.second_cost = std::min(ratio, kMaxCostRatio);
}

/// Measures the noise, refines the corners, drops those behind the camera, sets scale and
/// covariances.
Outcome<Reconstruction> refineStart(Reconstruction made, const AttemptContext& context) {
  InitialMap& map = made.map;
  InitReport& report = made.report;
  EssentialReport& found = *report.essential;
  const PinholeCamera& camera = context.camera;
  const OrbOptions& orb = context.options.orb;
  GeometricOptions adjusted = context.clock.time(
      "geometric", [&] { return adjustToNoise(map, camera, orb.geometric, kNoiseRounds); });
  found.track_noise = adjusted.sigma;
  context.clock.time("motions", [&] { estimateMotions(map, camera); });
  found.refinement = context.clock.time(
      "polish", [&] { return refineCorners(map, camera, adjusted, orb.polish_rounds); });
  if (!found.refinement.fits) return InitReason::kPoorQuality;
  if (found.refinement.accepted) adjusted = refinedAdjustment(adjusted);
  std::vector<char> behind(map.corners.size(), 0);
  for (std::size_t i = 0; i < behind.size(); ++i) {
    behind[i] = map.corners[i].inverse_depth > 0 ? 0 : 1;
  }
  removeCorners(map, behind);
  if (static_cast<int>(map.corners.size()) < orb.geometric.min_points ||
      !normalizeCornerScale(map)) {
    return InitReason::kTooFewPoints;
  }
  report.residual_rms = medianError(map, camera);
  found.variance_factor =
      context.clock.time("covariance", [&] { return setCovariances(map, camera, adjusted); });
  found.clustered_factor = map.cluster_variance_scale;
  if (map.motions.empty()) {
    found.readout_score =
        context.clock.time("readout", [&] { return scoreReadout(map, camera, adjusted); });
  }
  if (!std::isfinite(found.variance_factor)) return InitReason::kPoorQuality;
  return made;
}

/// Judges a refined start by everything that is known of it.
/// @param noise of a match about its epipolar line [px]
GateReport judge(const Reconstruction& made,
                 const Matches& matches,
                 double noise,
                 const AttemptContext& context) {
  const EssentialReport& found = *made.report.essential;
  const GateOptions& options = context.options.orb.gate;
  StartEvidence evidence{found.tracks, found.front_share, 1, found.second_cost};
  if (found.refinement.accepted) evidence.misfit = misfitOf(made.report.residual_rms);
  GateReport gate = judgeStart(made.map, context.camera, options, evidence);
  if (gate.reason != InitReason::kDone || made.map.scaleKnown()) return gate;  // no rivals there
  const RivalMotion rival = findRival(*made.map.frames.back().T_cam_ref,
                                      matches,
                                      context.camera,
                                      std::max(kMinMatchNoise, noise),
                                      options.wrong_angle_deg);
  addRival(gate, rival.probability(occupiedCells(made.map, context.camera)), options);
  return gate;
}

/// A refined start that passed, or why not, with its judgement and motion where it came so far.
struct JudgedStart {
  Outcome<Reconstruction> made;
  std::optional<GateReport> gate;
  std::optional<WaitingMotion> motion{};
};

WaitingMotion motionOf(const InitialMap& map, const GateReport& gate) {
  const PosedFrame& newest = map.frames.back();
  return {
      map.frames.front().frame->id(), *newest.T_cam_ref, newest.covariance, gate.wrong_probability};
}

JudgedStart refineAndJudge(const PlaneComparison& compared,
                           const SelectedMotion& selected,
                           const RotationFit& rotation,
                           const Matches& matches,
                           const AttemptContext& context) {
  Reconstruction start{compared.best.map, {}};
  start.report.model = name(compared.model);
  start.report.inlier_ratio =
      static_cast<double>(selected.motion.inliers) / static_cast<double>(matches.size());
  EssentialReport& found = start.report.essential.emplace();
  found.tracks = static_cast<int>(matches.size());
  found.inliers = selected.motion.inliers;
  found.rotation_residual = rotation.median_residual;
  found.front_share = compared.best.front_share;
  found.homography_gric = compared.homography_gric;
  found.second_cost = compared.second_cost;
  start.report.pose_prior = compared.best.motions_used;
  auto made = refineStart(std::move(start), context);
  if (!made) return {made.reason(), {}};
  const GateReport gate = context.clock.time(
      "gate", [&] { return judge(*made, matches, selected.motion.noise, context); });
  if (gate.reason != InitReason::kDone) return {gate.reason, gate, motionOf(made->map, gate)};
  made->report.essential->gate = gate;
  made->report.median_parallax_deg = gate.parallax_deg;
  made->report.wrong_probability = gate.wrong_probability;
  return {std::move(made), gate};
}

/// Whether a motion fits the epipolar geometry of all matches about as well as the best one does:
/// it does not where it was made to fit wrong depths.
bool fitsLikeTheBest(const SE3& T_cur_ref, const Matches& matches, const AttemptContext& context) {
  const auto best = estimateEssentialMotion(matches, context.camera, context.seed());
  if (!best) return true;
  const auto misfit = [&](const SE3& motion) {
    return medianOf(epipolarDistances(motion, matches, context.camera));
  };
  return misfit(T_cur_ref) <= kMaxMisfit * std::max(kMinMisfit, misfit(best->T_cur_ref));
}

/// A start from known depths, where the reference has any and they fit the images: the motion is a
/// pose from points, which has neither rivals nor the two solutions of a plane.
JudgedStart startFromKnownDepth(const ReferenceView& view,
                                const RotationFit& rotation,
                                const Matches& matches,
                                const AttemptContext& context,
                                DepthPriorReport& report) {
  auto candidate = context.clock.time(
      "known_depth", [&] { return makeKnownDepthCandidate(view, rotation, context, report); });
  if (!candidate) return {InitReason::kPoorQuality, {}};
  const SelectedMotion all{{*candidate->map.frames.back().T_cam_ref, {}, report.corners, 0}, 0, 0};
  const PlaneComparison known{std::move(*candidate), DisplacementModel::kEssential, {}, {}};
  JudgedStart start = refineAndJudge(known, all, rotation, matches, context);
  if (!start.made) return start;
  if (!fitsLikeTheBest(*start.made->map.frames.back().T_cam_ref, matches, context)) {
    report.contradicted = true;
    return {InitReason::kPoorQuality, {}};
  }
  start.made->report.model = "known_depth";
  return start;
}

}  // namespace

EssentialStart startFromEssential(const ReferenceView& view, const AttemptContext& context) {
  StageClock& clock = context.clock;
  AttemptSummary summary;
  const auto refuse = [&summary](InitReason reason) { return EssentialStart{reason, summary}; };
  const Matches matches = view.tracks.matchesTo(view.tracks.frames() - 1);
  const auto tracks = static_cast<int>(matches.size());
  if (tracks < kMinTracks) return refuse(InitReason::kTooFewPoints);
  const RotationFit rotation =
      clock.time("rotation", [&] { return fitRotation(matches, context.camera); });
  summary.rotation_residual = rotation.median_residual;
  std::optional<DepthPriorReport> depth_prior;
  if (knowsDepth(view)) {
    JudgedStart start =
        startFromKnownDepth(view, rotation, matches, context, depth_prior.emplace());
    if (start.made) {
      start.made->report.depth_prior = depth_prior;
      return {std::move(start.made), summary, start.motion};
    }
    depth_prior->used = false;
    if (depth_prior->inflation > kMaxInflation) depth_prior->contradicted = true;
    if (static_cast<int>(view.frames.size()) < context.options.orb.min_frames) {
      return {start.made.reason(), summary, start.motion};
    }
  }
  if (rotation.median_residual < kMinRotationResidual) {
    return refuse(InitReason::kTooLittleParallax);
  }
  if (!worthTheTime(view.last, rotation.median_residual, context.options.orb.gate)) {
    summary = view.last;
    ++summary.skipped;
    return refuse(summary.reason);
  }
  summary.tried = true;
  auto selected = selectMotion(matches, rotation, context);
  if (!selected) return refuse(selected.reason());
  auto candidate =
      clock.time("geometric", [&] { return makeCandidate(view, selected->motion, context); });
  if (!candidate) return refuse(InitReason::kTooFewPoints);
  PlaneComparison compared{std::move(*candidate), DisplacementModel::kEssential, {}, {}};
  JudgedStart start = refineAndJudge(compared, *selected, rotation, matches, context);
  if (start.made) {
    clock.time("planes", [&] { comparePlane(*selected, view, matches, context, compared); });
    start.made->report.essential->homography_gric = compared.homography_gric;
    if (compared.second_cost) {
      start = refineAndJudge(compared, *selected, rotation, matches, context);
    }
  }
  summary.gate = start.gate;
  if (start.made) start.made->report.depth_prior = depth_prior;
  return {std::move(start.made), summary, start.motion};
}

}  // namespace dsorb::init_orb
