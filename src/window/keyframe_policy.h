// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/window.h"

#include "window/window.h"

#include <Eigen/Core>

#include <vector>

namespace dsorb::window {

/// What tracking a frame says about the need of a keyframe.
struct KeyframeCues {
  double translation_flow = 0;  ///< mean squared flow by translation alone [px^2]
  double full_flow = 0;         ///< mean squared flow [px^2]
  double log_gain = 0;          ///< brightness, reference to frame
  int width_plus_height = 0;    ///< [px]
};

/// @source Engel et al., DSO, arXiv:1607.02565, section 3.1; weights as published
[[nodiscard]] bool needsKeyframe(const KeyframeCues& cues, const WindowOptions& options);

/// What the choice of leaving keyframes depends on.
struct KeyframeSummary {
  bool is_first = false;
  int alive = 0;        ///< points and candidates left
  int gone = 0;         ///< points that left
  double log_gain = 0;  ///< brightness, newest keyframe to this one
  Eigen::Vector3d center{0, 0, 0};
};

/// Keyframes that leave before one more is added: those with hardly any points or with another
/// brightness, then, if the window is full, the one whose distance score is worst.
/// @param keyframes  oldest first
/// @return           one flag a keyframe
/// @source           Engel et al., DSO, arXiv:1607.02565, section 3.1
[[nodiscard]] std::vector<bool> chooseLeaving(const std::vector<KeyframeSummary>& keyframes,
                                              const WindowOptions& options);

/// Sets the flag `leaves` of the window's keyframes. Called before the new keyframe is added.
void flagLeaving(Window& window, const WindowOptions& options);

}  // namespace dsorb::window
