// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/start/essential_start.h"

#include "init/orb/bundle/corner_refinement.h"
#include "init/orb/bundle/frame_motions.h"
#include "init/orb/bundle/geometric_covariance.h"
#include "init/orb/bundle/robust_adjustment.h"
#include "init/orb/start/known_motions.h"
#include "init/orb/start/motion_candidates.h"
#include "init/orb/start/readout.h"
#include "init/orb/start/start_gate.h"
#include "two_view/essential_motion.h"
#include "two_view/model_selection.h"
#include "two_view/rotation_only.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

namespace dsorb::init_orb {
namespace {

constexpr int kMinTracks = 50;                // of a reference, before an attempt
constexpr double kMinRotationResidual = 0.5;  // rotation-compensated flow; less: no parallax [px]
/// Least noise of the tracks in the competition of models [px]. With the measured 0.1 px a rotation
/// never wins on real images.
constexpr double kMinTrackNoise = 0.5;
/// A start is refined no further where its errors would have to shrink by this factor to pass.
constexpr double kHopelessFactor = 1.5;
/// Largest factor on the deviations of known depths with which they still give a scale, where they
/// are used for nothing else.
constexpr double kMaxInflation = 2;
constexpr int kNoiseRounds = 3;  // of measuring the noise and adjusting with it

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
  if (!context.options.skip.has(Mechanism::kRotation) &&
      gric(DisplacementModel::kRotation, errors, selected.noise) < selected.gric) {
    return InitReason::kTooLittleParallax;
  }
  return selected;
}

/// A map with scale and covariances.
struct CompletedMap {
  InitialMap map;
  double variance_factor = 0;  ///< not finite where nothing is determined
  double median_error = 0;     ///< medianError()
};

/// Drops corners behind the camera, sets scale and covariances.
/// @param refined whether corners were refined: then errors beyond the images' noise widen
/// @return nothing with too few corners
std::optional<CompletedMap> completeMap(InitialMap map,
                                        const GeometricOptions& adjusted,
                                        bool refined,
                                        const AttemptContext& context) {
  std::vector<char> behind(map.corners.size(), 0);
  for (std::size_t i = 0; i < behind.size(); ++i) {
    behind[i] = map.corners[i].inverse_depth > 0 ? 0 : 1;
  }
  removeCorners(map, behind);
  if (static_cast<int>(map.corners.size()) < kMinAdjusted || !normalizeCornerScale(map)) {
    return std::nullopt;
  }
  const double variance_factor =
      setCovariances(map, context.camera, adjusted, context.options.skip);
  const double median_error = medianError(map, context.camera);
  if (refined && !context.options.skip.has(Mechanism::kMisfit))
    widenCovariances(map, misfitOf(median_error));
  return CompletedMap{std::move(map), variance_factor, median_error};
}

/// Whether a start whose refinement has begun misses by so much that the rest of the refinement
/// would be in vain: the gate, or, where rows move, what is asked of a young start.
bool missesByFar(InitialMap map,
                 const GeometricOptions& adjusted,
                 const ReferenceView& view,
                 const AttemptContext& context) {
  const auto reached = completeMap(std::move(map), adjusted, true, context);
  if (!reached || !std::isfinite(reached->variance_factor)) return false;
  const GateOptions& options = context.options.orb.gate;
  const GateReport gate = judgeStart(reached->map, context.camera, options, {});
  return !errorsPass(gate, kHopelessFactor, options) ||
         isYoung(view, gate.direction_sigma_deg / kHopelessFactor);
}

/// A refined start with what is known of it beside its map.
struct RefinedStart {
  Reconstruction made;
  StartEvidence evidence;
};

void addDetails(const RefinementReport& refinement, InitReport& report) {
  report.add("refined", refinement.accepted ? 1 : 0);
  report.add("refine_first_rms", refinement.first_rms);
  report.add("refine_last_rms", refinement.last_rms);
  report.add("refine_turn_deg", refinement.direction_change_deg);
}

/// Measures the noise, refines the corners, drops those behind the camera, sets scale and
/// covariances.
/// @param doubtful the start is likely to be refused: the refinement ends early where it is
/// hopeless
Outcome<RefinedStart> refineStart(Reconstruction made,
                                  const ReferenceView& view,
                                  bool doubtful,
                                  StartEvidence evidence,
                                  const AttemptContext& context) {
  InitialMap& map = made.map;
  InitReport& report = made.report;
  const PinholeCamera& camera = context.camera;
  const OrbOptions& orb = context.options.orb;
  const Skips& skip = context.options.skip;
  const int rounds = skip.has(Mechanism::kNoise) ? 0 : kNoiseRounds;
  GeometricOptions adjusted = context.clock.time(
      "geometric", [&] { return adjustToNoise(map, camera, orb.geometric, rounds); });
  report.add("track_noise", adjusted.sigma);
  context.clock.time("motions", [&] {
    if (!skip.has(Mechanism::kRowMotions)) estimateMotions(map, camera);
  });
  const GeometricOptions refined = refinedAdjustment(adjusted);
  RefinementReport refinement;
  if (!skip.has(Mechanism::kRefinement)) {
    refinement = context.clock.time("refine", [&] {
      return refineCorners(map, camera, adjusted, [&](const InitialMap& begun) {
        return doubtful && !skip.has(Mechanism::kHopeless) &&
               missesByFar(begun, refined, view, context);
      });
    });
    addDetails(refinement, report);
  }
  if (!refinement.fits) return InitReason::kPoorQuality;
  if (refinement.accepted) adjusted = refined;
  auto reached = context.clock.time("covariance", [&] {
    return completeMap(std::move(map), adjusted, refinement.accepted, context);
  });
  if (!reached) return InitReason::kTooFewPoints;
  map = std::move(reached->map);
  made.adjustment = adjusted;
  report.add("median_error", reached->median_error);
  report.add("variance_factor", reached->variance_factor);
  report.add("clustered_factor", map.cluster_variance_scale);
  if (!std::isfinite(reached->variance_factor)) return InitReason::kPoorQuality;
  if (refinement.accepted) evidence.misfit = misfitOf(reached->median_error);
  return RefinedStart{std::move(made), evidence};
}

/// What two views tell of a start.
struct TwoViews {
  const ReferenceView& view;
  const Matches& matches;
  const RotationFit& rotation;
  const SelectedMotion& selected;
};

/// Judges a refined start by everything that is known of it.
GateReport judge(const RefinedStart& start, const TwoViews& views, const AttemptContext& context) {
  GateReport gate =
      judgeStart(start.made.map, context.camera, context.options.orb.gate, start.evidence);
  if (gate.reason == InitReason::kDone && !start.made.map.scaleKnown() &&
      !context.options.skip.has(Mechanism::kYoung) &&
      isYoung(views.view, gate.direction_sigma_deg)) {
    gate.reason = InitReason::kSettling;
  }
  return gate;
}

/// A refined start that passed, or why not, with its judgement and motion where it came so far.
struct JudgedStart {
  Outcome<Reconstruction> made;
  std::optional<GateReport> gate;
  std::optional<WaitingMotion> motion{};
  StartEvidence evidence{};                       ///< that it was judged by
  std::optional<DepthPriorReport> depth_prior{};  ///< where known depths were tried
};

WaitingMotion motionOf(const InitialMap& map, const GateReport& gate) {
  const PosedFrame& newest = map.frames.back();
  return {
      map.frames.front().frame->id(), *newest.T_cam_ref, newest.covariance, gate.wrong_probability};
}

/// A start with its judgement: refused, or passed and told in the report.
JudgedStart decided(Reconstruction made, const GateReport& gate) {
  if (gate.reason != InitReason::kDone) return {gate.reason, gate, motionOf(made.map, gate)};
  InitReport& report = made.report;
  report.wrong_probability = gate.wrong_probability;
  report.add("error_probability", gate.error_probability);
  report.add("plane_probability", gate.plane_probability);
  report.add("direction_sigma_deg", gate.direction_sigma_deg);
  report.add("second_sigma_deg", gate.second_sigma_deg);
  report.add("misfit", gate.misfit);
  report.add("depth_sigma", gate.depth_sigma);
  report.add("parallax_deg", gate.parallax_deg);
  return {std::move(made), gate};
}

void addDetails(const PlaneComparison& compared, InitReport& report) {
  if (compared.homography_gric) {
    report.add("gric_homography_over_essential", *compared.homography_gric);
  }
  if (compared.second_cost) report.add("second_motion_cost_ratio", *compared.second_cost);
}

/// @param doubtful see refineStart()
JudgedStart refineAndJudge(const PlaneComparison& compared,
                           const TwoViews& views,
                           bool doubtful,
                           const AttemptContext& context) {
  const SelectedMotion& selected = views.selected;
  Reconstruction start{compared.best.map, {}};
  start.live_tracks = static_cast<int>(views.matches.size());
  InitReport& report = start.report;
  report.model = name(compared.model);
  report.pose_prior = compared.best.motions_used;
  report.add("tracks", start.live_tracks);
  report.add("model_inliers", selected.motion.inliers);
  report.add("inlier_ratio", static_cast<double>(selected.motion.inliers) / start.live_tracks);
  report.add("rotation_residual_px", views.rotation.median_residual);
  report.add("front_share", compared.best.front_share);
  addDetails(compared, report);
  const StartEvidence evidence{
      start.live_tracks, compared.best.front_share, 1, compared.second_cost};
  auto refined = refineStart(std::move(start), views.view, doubtful, evidence, context);
  if (!refined) return {refined.reason(), {}};
  const GateReport gate =
      context.clock.time("gate", [&] { return judge(*refined, views, context); });
  JudgedStart decision = decided(std::move(refined->made), gate);
  decision.evidence = refined->evidence;
  return decision;
}

/// Judges a start that has passed anew, knowing the other motion of its plane.
JudgedStart judgeWithPlane(JudgedStart start,
                           const PlaneComparison& compared,
                           const AttemptContext& context) {
  start.made->report.model = name(compared.model);
  start.evidence.plane_cost_ratio = compared.second_cost;
  const GateOptions& options = context.options.orb.gate;
  const GateReport gate = judgeStart(start.made->map, context.camera, options, start.evidence);
  return decided(std::move(*start.made), gate);
}

/// Tells in the report what the tracks of a start say of the readout, where none is modelled.
void askReadout(Reconstruction& made, const AttemptContext& context) {
  if (!made.map.motions.empty()) return;
  const auto score = context.clock.time(
      "readout", [&] { return scoreReadout(made.map, context.camera, made.adjustment); });
  if (!score) return;
  made.report.add("readout_score_ms", 1000 * score->seconds);
  made.report.add("readout_score_sigma_ms", 1000 * score->sigma);
}

/// Tells in the report what became of known depths.
void tellDepthPrior(const DepthPriorReport& known, Reconstruction& made) {
  made.depth_prior = known;
  made.report.depth_prior = known.used;
  made.report.add("known_depth_contradicted", known.contradicted ? 1 : 0);
  made.report.add("known_depth_corners", known.corners);
  made.report.add("known_depth_inflation", known.inflation);
  made.report.add("known_depth_sigma", known.relative_sigma);
}

/// A start from known depths, where the reference has any and they fit the images: the motion is a
/// pose from points, which has not the two solutions of a plane.
JudgedStart startFromKnownDepth(const ReferenceView& view,
                                const RotationFit& rotation,
                                const Matches& matches,
                                const AttemptContext& context) {
  auto [candidate, report] = context.clock.time(
      "known_depth", [&] { return startOfKnownDepths(view, rotation, context); });
  JudgedStart start{InitReason::kPoorQuality, {}};
  if (candidate) {
    const SE3& motion = *candidate->map.frames.back().T_cam_ref;
    const SelectedMotion all{{motion, {}, report.corners, 0}, 0, 0};
    const PlaneComparison known{std::move(*candidate), DisplacementModel::kEssential, {}, {}};
    start = refineAndJudge(known, {view, matches, rotation, all}, false, context);
  }
  if (start.made && !fitsLikeTheBest(*start.made->map.frames.back().T_cam_ref, matches, context)) {
    report.contradicted = true;
    start = {InitReason::kPoorQuality, {}};
  }
  if (start.made) {
    start.made->report.model = "known_depth";
  } else {
    report.used = false;
    if (report.inflation > kMaxInflation) report.contradicted = true;
  }
  start.depth_prior = report;
  return start;
}

/// A start from the motion of two views, or from the other one that a plane allows, where that is
/// the better one.
JudgedStart startFromMotion(const TwoViews& views, const AttemptContext& context) {
  const ReferenceView& view = views.view;
  StageClock& clock = context.clock;
  auto candidate =
      clock.time("geometric", [&] { return makeCandidate(view, views.selected.motion, context); });
  if (!candidate) return {InitReason::kTooFewPoints, {}};
  PlaneComparison compared{std::move(*candidate), DisplacementModel::kEssential, {}, {}};
  const bool doubtful =
      isYoung(view, std::numeric_limits<double>::infinity()) ||
      refusedUnless(1, view.last, views.rotation.median_residual, context.options.orb.gate);
  JudgedStart start = refineAndJudge(compared, views, doubtful, context);
  if (!start.made) return start;
  if (context.options.skip.has(Mechanism::kPlane)) return start;
  clock.time("planes",
             [&] { comparePlane(views.selected, view, views.matches, context, compared); });
  if (compared.replaced) return refineAndJudge(compared, views, false, context);
  addDetails(compared, start.made->report);
  if (compared.second_cost) return judgeWithPlane(std::move(start), compared, context);
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
    JudgedStart start = startFromKnownDepth(view, rotation, matches, context);
    depth_prior = start.depth_prior;
    if (start.made) {
      summary.tried = true;
      askReadout(*start.made, context);
      tellDepthPrior(*depth_prior, *start.made);
      return {std::move(start.made), summary, start.motion};
    }
    if (static_cast<int>(view.frames.size()) < context.options.orb.min_frames) {
      return {start.made.reason(), summary, start.motion};
    }
  }
  if (rotation.median_residual < kMinRotationResidual) {
    return refuse(InitReason::kTooLittleParallax);
  }
  if (!context.options.skip.has(Mechanism::kRetry) &&
      !worthTheTime(view, rotation.median_residual, context.options.orb.gate)) {
    summary = view.last;
    summary.tried = false;
    ++summary.skipped;
    return refuse(summary.reason);
  }
  summary.tried = true;
  auto selected = selectMotion(matches, rotation, context);
  if (!selected) return refuse(selected.reason());
  JudgedStart start = startFromMotion({view, matches, rotation, *selected}, context);
  summary.gate = start.gate;
  if (start.made) {
    askReadout(*start.made, context);
    if (depth_prior) tellDepthPrior(*depth_prior, *start.made);
  }
  return {std::move(start.made), summary, start.motion};
}

}  // namespace dsorb::init_orb
