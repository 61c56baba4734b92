// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/window.h"

#include "window/window.h"

#include <cstddef>
#include <vector>

namespace dsorb::window {

/// Share that is kept of what points know when they leave, since their residuals are not
/// independent; as published.
constexpr double kMarginalizationWeight = 0.25;

enum class PointVerdict { kStay, kDiscard, kMarginalize };

/// Decides about a point after an adjustment: a point leaves with its host, when the newest
/// keyframe does not see it, or when too few residuals would remain; its information is kept if it
/// was observed well.
/// @source DSO as published; arXiv:1607.02565, section 2.3 (marginalization)
[[nodiscard]] PointVerdict judgePoint(const WindowPoint& point,
                                      bool host_leaves,
                                      const Window& window);

/// Judges all points, adds those to marginalise to the prior and takes all leaving ones out.
void retirePoints(Window& window, const WindowOptions& options);

/// Eliminates a keyframe without points from the prior and the window. Residuals to it are dropped.
/// @return the keyframe with its final estimate
/// @throws std::logic_error when it still has points
/// @source Leutenegger et al., Keyframe-Based Visual-Inertial Odometry, section 4.3
Keyframe marginalizeKeyframe(Window& window, std::size_t position, const WindowOptions& options);

/// Empties the prior where it was linearised with a focal length that was a guess and has turned
/// out wrong: it would hold on to it.
void forgetGuess(Window& window, const WindowOptions& options);

/// Marginalises every keyframe with the flag `leaves`. @return them, oldest first
std::vector<Keyframe> marginalizeFlagged(Window& window, const WindowOptions& options);

/// Schur complement: eliminates the last `count` variables of a quadratic energy.
[[nodiscard]] MarginalPrior eliminateLast(const MarginalPrior& prior, int count);

}  // namespace dsorb::window
