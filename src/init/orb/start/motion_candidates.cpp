// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/start/motion_candidates.h"

#include "base/spread_frames.h"
#include "geometry/triangulate.h"
#include "init/orb/bundle/map_assembly.h"
#include "init/orb/bundle/reprojection_equations.h"
#include "init/orb/bundle/robust_adjustment.h"
#include "init/orb/start/known_motions.h"
#include "two_view/decomposition.h"
#include "two_view/model_selection.h"

#include <algorithm>
#include <cstddef>
#include <limits>
#include <utility>

namespace dsorb::init_orb {
namespace {

constexpr double kSameDirection = 0.9986;    // cosine of 3 degrees: the same minimum
constexpr double kMinPlaneFrontShare = 0.5;  // of a plane's inliers
constexpr double kMaxCostRatio = 1000;       // of a plane's motions: files hold no infinity

std::optional<TriangulatedPoint> triangulate(const SE3& T_cur_ref,
                                             const Matches& matches,
                                             std::size_t i,
                                             const PinholeCamera& camera) {
  return triangulateInverseDepth(T_cur_ref,
                                 camera.unproject(matches.reference[i]),
                                 camera.unproject(matches.target[i]).head<2>(),
                                 1.0 / camera.fx);
}

/// Corners of all inliers, on either side of the camera.
MotionHypothesis triangulateInliers(const EssentialMotion& motion,
                                    const Matches& matches,
                                    const PinholeCamera& camera) {
  MotionHypothesis hypothesis;
  hypothesis.T_cur_ref = motion.T_cur_ref;
  hypothesis.points.resize(matches.size());
  for (std::size_t i = 0; i < matches.size(); ++i) {
    if (motion.inlier[i] != 0) {
      hypothesis.points[i] = triangulate(motion.T_cur_ref, matches, i, camera);
    }
  }
  return hypothesis;
}

double frontShare(const EssentialMotion& motion,
                  const Matches& matches,
                  const PinholeCamera& camera) {
  int in_front = 0;
  for (std::size_t i = 0; i < matches.size(); ++i) {
    if (motion.inlier[i] == 0) continue;
    const auto point = triangulate(motion.T_cur_ref, matches, i, camera);
    if (point && point->inverse_depth > 0) ++in_front;
  }
  return motion.inliers > 0 ? static_cast<double>(in_front) / motion.inliers : 0;
}

}  // namespace

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
  MotionAdjustment adjusted = adjustWithMotions(
      std::move(*robust), knownMotions(view.frames, frames), context.camera, options);
  MotionCandidate candidate;
  candidate.map = std::move(adjusted.map);
  candidate.motions_used = adjusted.used;
  const auto cost = reprojectionCost(candidate.map, context.camera, options);
  if (!cost) return std::nullopt;
  const auto tracks = static_cast<double>(matches.size());
  const double lost = (tracks - static_cast<double>(candidate.map.corners.size())) *
                      robustCost(kSevereLimit / options.sigma, options);
  candidate.cost = *cost / (tracks * static_cast<double>(frames.size())) + lost / tracks;
  candidate.front_share = flipToPositiveDepth(candidate.map);
  return candidate;
}

std::vector<EssentialMotion> planeMotions(const Eigen::Matrix3d& H_cur_ref,
                                          const Matches& matches,
                                          const PinholeCamera& camera,
                                          double threshold) {
  const std::vector<double> errors = homographySampsonErrors(H_cur_ref, matches);
  EssentialMotion motion;
  for (const double error : errors) motion.inlier.push_back(error < threshold * threshold ? 1 : 0);
  motion.inliers = static_cast<int>(std::count(motion.inlier.begin(), motion.inlier.end(), 1));
  std::vector<EssentialMotion> motions;
  for (const SE3& decomposed : decomposeHomography(H_cur_ref, camera)) {
    motion.T_cur_ref = decomposed;
    if (frontShare(motion, matches, camera) > kMinPlaneFrontShare) motions.push_back(motion);
  }
  return motions;
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
    if (!(other.cost < best.cost)) continue;
    std::swap(other, best);
    outcome.replaced = true;
  }
  for (const MotionCandidate& other : others) {
    if (is_same(other, best)) continue;
    outcome.cost_ratio = std::min(outcome.cost_ratio, other.cost / best.cost);
  }
  return outcome;
}

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
  const Competition outcome = competeOverFrames(
      view, planeMotions(*H, matches, context.camera, kRansacThreshold), context, compared.best);
  compared.second_cost = std::min(outcome.cost_ratio, kMaxCostRatio);
  compared.replaced = outcome.replaced;
}

}  // namespace dsorb::init_orb
