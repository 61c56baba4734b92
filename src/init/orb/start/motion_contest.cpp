// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/start/motion_contest.h"

#include "init/orb/two_view/motion_refinement.h"
#include "init/wrong_direction.h"

#include <algorithm>

namespace dsorb::init_orb {
namespace {

constexpr double kMaxCostRatio = 1000;  // of a plane's motions: files hold no infinity

}  // namespace

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

std::vector<EssentialMotion> carriedOver(const AttemptSummary& last,
                                         const Eigen::Quaterniond& R_cur_ref,
                                         const Matches& matches,
                                         const PinholeCamera& camera) {
  std::vector<EssentialMotion> motions;
  if (last.motions.empty()) return motions;
  const SE3 turned(R_cur_ref * last.motions.front().unitQuaternion().inverse(),
                   Eigen::Vector3d::Zero());
  const std::vector<char> all(matches.size(), 1);
  for (const SE3& motion : last.motions) {
    const SE3 near = refineMotion(turned * motion, matches, all, camera, kRansacThreshold);
    motions.push_back(refineOnInliers(near, matches, camera, kRansacThreshold));
  }
  return motions;
}

RivalVerdict judgeRivals(const std::vector<SE3>& rivals,
                         const MotionCandidate& own,
                         double samples,
                         const ReferenceView& view,
                         const AttemptContext& context) {
  const Matches matches = view.tracks.matchesTo(view.tracks.frames() - 1);
  std::vector<EssentialMotion> motions;
  motions.reserve(rivals.size());
  for (const SE3& rival : rivals) {
    motions.push_back(refineOnInliers(rival, matches, context.camera, kRansacThreshold));
  }
  MotionCandidate best = own;
  const Competition outcome = competeOverFrames(view, motions, context, best);
  const double loser = rivalProbability(outcome.cost_ratio, samples);
  RivalVerdict verdict;
  verdict.probability = outcome.replaced ? 1 - loser : loser;
  const SE3& T_own_ref = *own.map.frames.back().T_cam_ref;
  verdict.motions.emplace_back(
      SE3(T_own_ref.unitQuaternion(), T_own_ref.translation().normalized()));
  verdict.motions.insert(verdict.motions.end(), rivals.begin(), rivals.end());
  return verdict;
}

}  // namespace dsorb::init_orb
