// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/options/orb_mapping.h"

#include "init/orb/map/attempt_types.h"
#include "init/orb/map/initial_map.h"
#include "init/orb/start/essential_start.h"
#include "two_view/model_selection.h"

#include <cstddef>
#include <optional>
#include <vector>

namespace dsorb::init_orb {

/// Motions that the caller knows between the reference and some frames after it, each since the
/// nearest of them on its chain of priors.
/// @param all    frames, the reference first
/// @param frames ascending indices; the reference counts as one of them
std::vector<KnownMotion> knownMotions(const std::vector<FramePtr>& all,
                                      const std::vector<std::size_t>& frames);

/// Adjusts a map once more with the motions, unless they contradict the images: the corners then
/// fit worse than errors of the motions as claimed let expect. The map stays as it was then.
/// @param map adjusted without them
/// @return    whether the motions take part from now on; nothing: there are none
std::optional<bool> adjustWithMotions(InitialMap& map,
                                      const std::vector<KnownMotion>& motions,
                                      const PinholeCamera& camera,
                                      const GeometricOptions& options);

/// Whether the caller knows depths of the reference.
bool knowsDepth(const ReferenceView& view);

/// An inverse depth that is known, and what the images say of it.
struct DepthInnovation {
  double error = 0;           ///< what the images add to it [1/unit]
  double known_variance = 0;  ///< as claimed [1/unit^2]
  double image_variance = 0;  ///< of the error by the images' noise [1/unit^2]
};

/// How much larger than claimed the standard deviations of known depths are: the least factor that
/// the images do not contradict. One where the claim is right, or too careful, or where the images
/// cannot tell. Errors have heavy tails: outliers alone do not raise it.
/// @param innovations of corners, at least one
double claimInflation(const std::vector<DepthInnovation>& innovations);

/// A start that was made of known depths, and what became of them.
struct KnownDepthStart {
  std::optional<MotionCandidate> candidate;  ///< none where too few corners have a depth, or where
                                             ///< the depths contradict the images
  DepthPriorReport report;
};

/// A map from known depths: the newest frame posed by the corners that have one, the claimed
/// deviations widened until they fit the images, a few frames adjusted together with the corners.
/// The unit is a metre (or the prior's own).
KnownDepthStart startOfKnownDepths(const ReferenceView& view,
                                   const RotationFit& rotation,
                                   const AttemptContext& context);

/// Whether a motion fits the epipolar geometry of all matches about as well as the best one does:
/// it does not where it was made to fit wrong depths.
bool fitsLikeTheBest(const SE3& T_cur_ref, const Matches& matches, const AttemptContext& context);

}  // namespace dsorb::init_orb
