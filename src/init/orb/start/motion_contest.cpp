// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/start/motion_contest.h"

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

}  // namespace dsorb::init_orb
