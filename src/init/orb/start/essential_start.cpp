// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/start/essential_start.h"

#include "base/angles.h"
#include "base/median.h"
#include "base/spread_frames.h"
#include "estimate/variance_factors.h"
#include "geometry/triangulate.h"
#include "init/orb/bundle/corner_refinement.h"
#include "init/orb/bundle/geometric_covariance.h"
#include "init/orb/bundle/map_assembly.h"
#include "init/orb/bundle/reprojection_equations.h"
#include "init/orb/bundle/robust_adjustment.h"
#include "init/orb/start/known_motions.h"
#include "init/orb/start/readout.h"
#include "init/result.h"
#include "two_view/essential_motion.h"
#include "two_view/model_selection.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <numeric>
#include <optional>
#include <set>
#include <utility>
#include <vector>

namespace dsorb::init_orb {
namespace {

// Without the first two a start of a turning Kinect was 123 degrees off, with 58 corners.
constexpr int kMinCorners = 60;
constexpr double kTrackShare = 0.5;     // of the reference's live tracks, left in a start
constexpr double kMinFrontShare = 0.8;  // of the corners, in front of the camera
constexpr double kFartherShare = 0.75;  // of the corners, which are farther than the near part
/// Factor by which errors miss the gate that make more work on a start vain: an attempt is left out
/// where the last one from this reference, extrapolated by the growth of the parallax, misses by
/// more, and corners are refined no further, which saves a sixth of the time.
constexpr double kHopelessFactor = 1.5;
constexpr int kMaxSkippedFrames = 1;       // but so many times in a row at most
constexpr std::size_t kGrownUpFrames = 8;  // of a start whose rows move; with fewer its direction
constexpr double kYoungSigmaDeg = 0.5;     // has to be as sure as this

constexpr double kSameDirection = 0.9986;    // cosine of 3 degrees: the same minimum
constexpr double kMinPlaneFrontShare = 0.5;  // of a motion's inliers
/// Most that a cell of the image says of two motions, over the median of what cells say. Without it
/// 7 of 420 starts on planes were wrong, with it none, given .7 frames more.
constexpr double kCellLimit = 2;
constexpr double kMaxCostRatio = 1000;  // of a plane's motions: files hold no infinity

/// Corners of all inliers, on either side of the camera.
MotionHypothesis triangulateInliers(const EssentialMotion& motion,
                                    const Matches& matches,
                                    const PinholeCamera& camera) {
  MotionHypothesis hypothesis;
  hypothesis.T_cur_ref = motion.T_cur_ref;
  hypothesis.points.resize(matches.size());
  for (std::size_t i = 0; i < matches.size(); ++i) {
    if (motion.inlier[i] == 0) continue;
    hypothesis.points[i] = triangulateInverseDepth(motion.T_cur_ref,
                                                   camera.unproject(matches.reference[i]),
                                                   camera.unproject(matches.target[i]).head<2>(),
                                                   1.0 / camera.fx);
  }
  return hypothesis;
}

double frontShare(const EssentialMotion& motion,
                  const Matches& matches,
                  const PinholeCamera& camera) {
  const auto points = triangulateInliers(motion, matches, camera).points;
  const auto in_front = std::count_if(points.begin(), points.end(), [](const auto& point) {
    return point && point->inverse_depth > 0;
  });
  return motion.inliers > 0 ? static_cast<double>(in_front) / motion.inliers : 0;
}

/// Robust cost of the tracks in every cell of the image, in the mean frame; that of tracks without
/// a corner is the severe limit's. Behind the cells is the cost of what is known beside the tracks.
/// @return nullopt where a corner is behind a camera
std::optional<std::vector<double>> cellCosts(const InitialMap& map,
                                             const Matches& matches,
                                             std::size_t frames,
                                             const AttemptContext& context) {
  const GeometricOptions& options = context.options.orb.geometric;
  const double lost = robustCost(kSevereLimit / options.sigma, options);
  double of_tracks = 0;
  std::vector<double> costs(kErrorCells);
  const auto cost_at = [&](const Eigen::Vector2d& pixel) -> double& {
    return costs[imageCell(pixel, context.camera)];
  };
  for (const Eigen::Vector2d& pixel : matches.reference) cost_at(pixel) += lost;
  for (const Corner& corner : map.corners) cost_at(corner.pixel) -= lost;
  for (const CornerObservation& observation : map.observations) {
    if (!map.frames[observation.frame].T_cam_ref) continue;
    const auto error = errorOf(map, context.camera, observation, options.sigma);
    if (!error) return std::nullopt;
    const double cost = robustCost(error->value.norm(), options);
    cost_at(map.corners[observation.corner].pixel) += cost / static_cast<double>(frames);
    of_tracks += cost;
  }
  if (map.known_motions.empty()) {
    costs.push_back(0);
    return costs;
  }
  const auto of_all = reprojectionCost(map, context.camera, options);
  if (!of_all) return std::nullopt;
  costs.push_back((*of_all - of_tracks) / static_cast<double>(frames));
  return costs;
}

/// A motion between two views, and how well its model explains the matches.
struct SelectedMotion {
  EssentialMotion motion;
  double noise = 0;  ///< of a match [px]
  double gric = 0;
};

/// Where a homography explains the matches better, both motions of the plane compete with the best
/// motion so far. @return nothing where none does
std::optional<Competition> comparePlane(const SelectedMotion& selected,
                                        const ReferenceView& view,
                                        const Matches& matches,
                                        const AttemptContext& context,
                                        MotionCandidate& best) {
  const auto H = estimateHomography(matches, context.seed());
  if (!H) return std::nullopt;
  const double homography_gric =
      gric(DisplacementModel::kHomography, homographySampsonErrors(*H, matches), selected.noise);
  if (homography_gric >= selected.gric) return std::nullopt;
  const auto motions = planeMotions(*H, matches, context.camera);
  return competeOverFrames(view, motions, context, best);
}

constexpr double kMinRotationResidual = 0.5;  // rotation-compensated flow; less: no parallax [px]
/// Least noise of the tracks in the competition of models [px]. With the measured 0.1 px a rotation
/// never wins on real images.
constexpr double kMinTrackNoise = 0.5;
/// Largest factor on the deviations of known depths with which they still give a scale, where they
/// are used for nothing else.
constexpr double kMaxInflation = 2;
constexpr int kNoiseRounds = 3;  // of measuring the noise and adjusting with it

/// Median angle between the rays to a corner from the reference and from the newest frame [deg].
double medianParallaxDeg(const InitialMap& map, const PinholeCamera& camera) {
  const std::size_t newest = map.frames.size() - 1;
  std::vector<double> angles;
  for (const CornerObservation& observation : map.observations) {
    if (observation.frame != newest) continue;
    const Corner& corner = map.corners[observation.corner];
    angles.push_back(parallaxAngle(*map.frames.back().T_cam_ref,
                                   camera.unproject(corner.pixel),
                                   camera.unproject(observation.pixel)));
  }
  return medianOf(std::move(angles)) * kDegPerRad;
}

/// Whether the last attempt from this reference, extrapolated by the growth of the parallax, tells
/// that the next one is refused unless the parallax is this much larger still.
bool refusedUnless(double larger,
                   const AttemptSummary& last,
                   double rotation_residual,
                   const GateOptions& gate) {
  return last.gate &&
         !errorsPass(*last.gate, larger * rotation_residual / last.rotation_residual, gate);
}

/// Whether enough has changed since the last attempt from this reference: the predicted errors fall
/// as the rotation-compensated flow grows.
bool worthTheTime(const ReferenceView& view, double rotation_residual, const GateOptions& gate) {
  const AttemptSummary& last = view.last;
  const bool was_young = last.gate && last.reason == InitReason::kSettling;
  if (was_young) return view.frames.size() >= kGrownUpFrames;
  return last.skipped >= kMaxSkippedFrames ||
         !refusedUnless(kHopelessFactor, last, rotation_residual, gate);
}

/// Whether a start that passes should wait all the same: its rows move, and of a few frames their
/// motion is mostly what the frames around let expect. Without this directions are 1.50 +- .23
/// times as wrong there.
bool isYoung(const ReferenceView& view, double direction_sigma_deg) {
  const bool rows_move = view.readout && view.readout->seconds != 0;
  return rows_move && view.frames.size() < kGrownUpFrames && direction_sigma_deg > kYoungSigmaDeg;
}

/// Tail of the direction's errors if they had shrunk by a factor.
double errorProbability(const GateReport& report, double shrunk_by, const GateOptions& options) {
  const Eigen::Vector2d sigmas(report.second_sigma_deg, report.direction_sigma_deg);
  return tailProbability(sigmas / shrunk_by, options.wrong_angle_deg);
}

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

/// Drops corners behind the camera, sets scale and covariances.
/// @param refined whether corners were refined: then errors beyond the images' noise widen
/// @return the misfit of refined corners; 1 of others
Outcome<double> completeMap(InitialMap& map,
                            const GeometricOptions& adjusted,
                            bool refined,
                            const AttemptContext& context) {
  std::vector<char> behind(map.corners.size(), 0);
  for (std::size_t i = 0; i < behind.size(); ++i) {
    behind[i] = map.corners[i].inverse_depth > 0 ? 0 : 1;
  }
  removeCorners(map, behind);
  if (static_cast<int>(map.corners.size()) < kMinCornersOfMotion || !normalizeCornerScale(map)) {
    return InitReason::kTooFewPoints;
  }
  const Skips& skip = context.options.skip;
  if (!std::isfinite(setCovariances(map, context.camera, adjusted, skip))) {
    return InitReason::kPoorQuality;
  }
  if (!refined) return 1.0;
  double misfit = misfitOf(medianError(map, context.camera));
  if (!skip.has(Mechanism::kMisfit)) widenCovariances(map, misfit);
  return misfit;
}

/// Whether a start whose refinement has begun misses by so much that the rest of the refinement
/// would be in vain: the gate, or, where rows move, what is asked of a young start.
bool missesByFar(InitialMap map,
                 const LiveTracks& live,
                 const GeometricOptions& adjusted,
                 const ReferenceView& view,
                 const AttemptContext& context) {
  if (!completeMap(map, adjusted, true, context)) return false;
  const GateOptions& options = context.options.orb.gate;
  const GateReport gate = judgeStart(map, context.camera, options, {live, 1, 1, {}});
  return !errorsPass(gate, kHopelessFactor, options) ||
         isYoung(view, gate.direction_sigma_deg / kHopelessFactor);
}

/// Measures the noise, refines the corners, drops those behind the camera, sets scale and
/// covariances.
/// @param doubtful the start is likely to be refused: the refinement ends early where it is
/// hopeless
/// @param evidence gets the misfit of refined corners
Outcome<Reconstruction> refineStart(Reconstruction made,
                                    const ReferenceView& view,
                                    bool doubtful,
                                    StartEvidence& evidence,
                                    const AttemptContext& context) {
  InitialMap& map = made.map;
  const PinholeCamera& camera = context.camera;
  const OrbOptions& orb = context.options.orb;
  const Skips& skip = context.options.skip;
  const int rounds = skip.has(Mechanism::kNoise) ? 0 : kNoiseRounds;
  GeometricOptions adjusted = context.clock.time(
      "geometric", [&] { return adjustToNoise(map, camera, orb.geometric, rounds); });
  context.clock.time("motions", [&] {
    if (!skip.has(Mechanism::kRowMotions)) estimateMotions(map, camera);
  });
  const GeometricOptions refined = refinedAdjustment(adjusted);
  RefinementReport refinement;
  if (!skip.has(Mechanism::kRefinement)) {
    refinement = context.clock.time("refine", [&] {
      return refineCorners(map, camera, adjusted, [&](const InitialMap& begun) {
        return doubtful && !skip.has(Mechanism::kHopeless) &&
               missesByFar(begun, made.live, refined, view, context);
      });
    });
  }
  if (!refinement.fits) return InitReason::kPoorQuality;
  if (refinement.accepted) adjusted = refined;
  auto misfit = context.clock.time(
      "covariance", [&] { return completeMap(map, adjusted, refinement.accepted, context); });
  if (!misfit) return misfit.reason();
  evidence.misfit = *misfit;
  made.adjustment = adjusted;
  return made;
}

/// Judges a refined start by everything that is known of it.
GateReport judge(const InitialMap& map,
                 const StartEvidence& evidence,
                 const ReferenceView& view,
                 const AttemptContext& context) {
  GateReport gate = judgeStart(map, context.camera, context.options.orb.gate, evidence);
  if (gate.reason == InitReason::kDone && !map.scaleKnown() &&
      !context.options.skip.has(Mechanism::kYoung) && isYoung(view, gate.direction_sigma_deg)) {
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
  report.add("misfit", gate.misfit);
  report.add("depth_sigma", gate.depth_sigma);
  report.add("parallax_deg", gate.parallax_deg);
  return {std::move(made), gate};
}

/// What the competition with the motions of a plane says of a start.
void tellPlane(const std::optional<Competition>& plane,
               StartEvidence& evidence,
               InitReport& report) {
  report.model = name(plane ? DisplacementModel::kHomography : DisplacementModel::kEssential);
  if (plane) evidence.plane_cost_ratio = std::min(plane->cost_ratio, kMaxCostRatio);
}

/// @param plane    where motions of a plane have competed
/// @param doubtful see refineStart()
JudgedStart refineAndJudge(const MotionCandidate& candidate,
                           const std::optional<Competition>& plane,
                           const ReferenceView& view,
                           bool doubtful,
                           const AttemptContext& context) {
  Reconstruction start{candidate.map, {}};
  start.live = {candidate.live_tracks, view.matched};
  start.report.pose_prior = candidate.motions_used;
  StartEvidence evidence{start.live, candidate.front_share, 1, {}};
  tellPlane(plane, evidence, start.report);
  start.report.add("tracks", start.live.count);
  auto refined = refineStart(std::move(start), view, doubtful, evidence, context);
  if (!refined) return {refined.reason(), {}};
  const GateReport gate =
      context.clock.time("gate", [&] { return judge(refined->map, evidence, view, context); });
  JudgedStart decision = decided(std::move(*refined), gate);
  decision.evidence = evidence;
  return decision;
}

/// Judges a start that has passed anew, knowing the other motion of its plane.
JudgedStart judgeWithPlane(JudgedStart start,
                           const Competition& plane,
                           const AttemptContext& context) {
  tellPlane(plane, start.evidence, start.made->report);
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
  made.report.add("known_depth_inflation", known.inflation);
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
  if (candidate) start = refineAndJudge(*candidate, {}, view, false, context);
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
JudgedStart startFromMotion(const ReferenceView& view,
                            const Matches& matches,
                            const RotationFit& rotation,
                            const SelectedMotion& selected,
                            const AttemptContext& context) {
  StageClock& clock = context.clock;
  auto best =
      clock.time("geometric", [&] { return makeCandidate(view, selected.motion, context); });
  if (!best) return {InitReason::kTooFewPoints, {}};
  const bool doubtful =
      isYoung(view, std::numeric_limits<double>::infinity()) ||
      refusedUnless(1, view.last, rotation.median_residual, context.options.orb.gate);
  JudgedStart start = refineAndJudge(*best, {}, view, doubtful, context);
  if (!start.made || context.options.skip.has(Mechanism::kPlane)) return start;
  const std::optional<Competition> plane =
      clock.time("planes", [&] { return comparePlane(selected, view, matches, context, *best); });
  if (!plane) return start;
  return plane->replaced ? refineAndJudge(*best, plane, view, false, context)
                         : judgeWithPlane(std::move(start), *plane, context);
}

}  // namespace

double depthSigma(const std::vector<Corner>& corners) {
  std::vector<double> inverse_depths;
  inverse_depths.reserve(corners.size());
  for (const Corner& corner : corners) inverse_depths.push_back(corner.inverse_depth);
  const double scene = quantileInPlace(inverse_depths, kFartherShare);
  std::vector<double> errors;
  errors.reserve(corners.size());
  for (const Corner& corner : corners) {
    errors.push_back(std::sqrt(corner.variance) / std::max(scene, corner.inverse_depth));
  }
  return medianInPlace(errors);
}

double misfitOf(double median_error) {
  return std::max(1.0, median_error / kMedianLength);
}

bool hasEnoughCorners(const InitialMap& map, const LiveTracks& live) {
  const auto corners = static_cast<double>(map.corners.size());
  return corners >= kMinCorners && (live.matched || corners >= kTrackShare * live.count);
}

double lostTracksFactor(const InitialMap& map, const LiveTracks& live) {
  const auto corners = static_cast<double>(std::max<std::size_t>(map.corners.size(), 1));
  return std::max(1.0, kTrackShare * live.count / corners);
}

int occupiedCells(const InitialMap& map, const PinholeCamera& camera) {
  std::set<std::size_t> cells;
  for (const Corner& corner : map.corners) cells.insert(imageCell(corner.pixel, camera));
  return static_cast<int>(cells.size());
}

GateReport judgeStart(const InitialMap& map,
                      const PinholeCamera& camera,
                      const GateOptions& options,
                      const StartEvidence& evidence) {
  GateReport report;
  report.misfit = evidence.misfit;
  report.parallax_deg = medianParallaxDeg(map, camera);
  report.lost_factor = lostTracksFactor(map, evidence.live);
  const Eigen::Vector2d sigmas = report.lost_factor * variance_factors::kStartDirection *
                                 directionSigmasDeg(map.frames.back());
  report.direction_sigma_deg = sigmas[1];
  report.second_sigma_deg = sigmas[0];
  report.depth_sigma = report.lost_factor * depthSigma(map.corners);
  report.error_probability = errorProbability(report, 1, options);
  if (evidence.plane_cost_ratio) {
    report.plane_probability = rivalProbability(*evidence.plane_cost_ratio,
                                                static_cast<double>(occupiedCells(map, camera)));
  }
  report.wrong_probability = wrongProbability(report, 1, options);
  if (!hasEnoughCorners(map, evidence.live)) {
    report.reason = InitReason::kTooFewPoints;
  } else if (evidence.front_share < kMinFrontShare ||
             !(report.plane_probability <= options.max_wrong_probability)) {
    report.reason = InitReason::kDegenerateMotion;
  } else if (!(report.depth_sigma <= options.max_depth_sigma)) {
    report.reason = InitReason::kTooLittleParallax;
  } else if (!(report.wrong_probability <= options.max_wrong_probability)) {
    report.reason = InitReason::kPoorQuality;
  }
  return report;
}

bool errorsPass(const GateReport& report, double shrunk_by, const GateOptions& options) {
  return report.depth_sigma / shrunk_by <= options.max_depth_sigma &&
         errorProbability(report, shrunk_by, options) <= options.max_wrong_probability;
}

double wrongProbability(const GateReport& report, double shrunk_by, const GateOptions& options) {
  return 1 - (1 - errorProbability(report, shrunk_by, options)) * (1 - report.plane_probability);
}

std::optional<MotionCandidate> makeCandidate(const ReferenceView& view,
                                             const EssentialMotion& motion,
                                             const AttemptContext& context) {
  const GeometricOptions& options = context.options.orb.geometric;
  const Matches matches = view.tracks.matchesTo(view.tracks.frames() - 1);
  const std::vector<std::size_t> frames = spreadFrames(view.frames.size(), kAdjustedFrames);
  InitialMap start =
      makeInitialMap(view.frames, view.tracks, triangulateInliers(motion, matches, context.camera));
  start.readout = view.readout;
  poseFrames(start, context.camera, frames);
  auto robust = adjustRobustly(std::move(start), context.camera, options);
  if (!robust) return std::nullopt;
  MotionCandidate candidate;
  candidate.live_tracks = view.tracks.size();
  candidate.map = std::move(*robust);
  candidate.motions_used =
      adjustWithMotions(candidate.map, knownMotions(view.frames, frames), context.camera, options);
  auto costs = cellCosts(candidate.map, matches, frames.size(), context);
  if (!costs) return std::nullopt;
  candidate.cost =
      std::accumulate(costs->begin(), costs->end(), 0.0) / static_cast<double>(matches.size());
  if (!std::isfinite(candidate.cost)) return std::nullopt;
  candidate.cell_costs = std::move(*costs);
  candidate.front_share = flipToPositiveDepth(candidate.map);
  return candidate;
}

std::vector<EssentialMotion> planeMotions(const Eigen::Matrix3d& H_cur_ref,
                                          const Matches& matches,
                                          const PinholeCamera& camera) {
  std::vector<EssentialMotion> motions;
  for (const SE3& decomposed : decomposeHomography(H_cur_ref, camera)) {
    EssentialMotion motion;
    motion.T_cur_ref = decomposed;
    countInliers(matches, camera, kRansacThreshold, motion);
    if (frontShare(motion, matches, camera) > kMinPlaneFrontShare) motions.push_back(motion);
  }
  return motions;
}

double costRatio(const MotionCandidate& other, const MotionCandidate& best) {
  const std::vector<double>& costs = best.cell_costs;
  std::vector<double> differences(costs.size());
  std::vector<double> sizes;
  sizes.reserve(costs.size());
  for (std::size_t i = 0; i < costs.size(); ++i) {
    differences[i] = other.cell_costs[i] - costs[i];
    if (differences[i] != 0) sizes.push_back(std::abs(differences[i]));
  }
  if (sizes.empty()) return 1;
  const double limit = kCellLimit * medianInPlace(sizes);
  double worse = differences.back();
  for (std::size_t i = 0; i + 1 < differences.size(); ++i) {
    worse += std::clamp(differences[i], -limit, limit);
  }
  return 1 + worse / std::accumulate(costs.begin(), costs.end(), 0.0);
}

Competition competeOverFrames(const ReferenceView& view,
                              const std::vector<EssentialMotion>& motions,
                              const AttemptContext& context,
                              MotionCandidate& best) {
  const auto is_same = [](const MotionCandidate& a, const MotionCandidate& b) {
    const auto direction = [](const MotionCandidate& candidate) {
      return candidate.map.frames.back().T_cam_ref->translation().normalized();
    };
    return direction(a).dot(direction(b)) > kSameDirection;
  };
  std::vector<MotionCandidate> others;
  for (const EssentialMotion& motion : motions) {
    auto candidate = makeCandidate(view, motion, context);
    if (candidate && !is_same(*candidate, best)) others.push_back(std::move(*candidate));
  }
  Competition outcome{std::numeric_limits<double>::infinity(), false};
  for (MotionCandidate& other : others) {
    if (!(costRatio(other, best) < 1)) continue;
    std::swap(other, best);
    outcome.replaced = true;
  }
  for (const MotionCandidate& other : others) {
    if (is_same(other, best)) continue;
    outcome.cost_ratio = std::min(outcome.cost_ratio, costRatio(other, best));
  }
  return outcome;
}

Attempt startFromEssential(const ReferenceView& view, const AttemptContext& context) {
  StageClock& clock = context.clock;
  AttemptSummary summary;
  const auto refuse = [&summary](InitReason reason) { return Attempt{reason, summary}; };
  const Matches matches = view.tracks.matchesTo(view.tracks.frames() - 1);
  const auto tracks = static_cast<int>(matches.size());
  if (tracks < kMinCornersOfMotion) return refuse(InitReason::kTooFewPoints);
  const RotationFit rotation =
      clock.time("rotation", [&] { return fitRotation(matches, context.camera); });
  summary.rotation_residual = rotation.median_residual;
  std::optional<DepthPriorReport> depth_prior;
  if (knowsDepth(view)) {
    JudgedStart start = startFromKnownDepth(view, rotation, matches, context);
    depth_prior = start.depth_prior;
    if (start.made) {
      summary.tried = true;
      summary.gate = start.gate;
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
  JudgedStart start = startFromMotion(view, matches, rotation, *selected, context);
  summary.gate = start.gate;
  if (start.made) {
    askReadout(*start.made, context);
    if (depth_prior) tellDepthPrior(*depth_prior, *start.made);
  }
  return {std::move(start.made), summary, start.motion};
}

}  // namespace dsorb::init_orb
