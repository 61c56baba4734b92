// SPDX-License-Identifier: BSD-3-Clause
#include "io/retired_keys.h"

#include "io/yaml_assignments.h"

#include <algorithm>

namespace dsorb::io {

const std::vector<RetiredKey>& retiredKeys() {
  static const std::vector<RetiredKey> keys = {
      {"initializer.orb.semi_dense.patch", "is gone: the patch is always the 8-pixel pattern"},
      {"initializer.orb.semi_dense.brightness",
       "is gone: patches are always compared by the affine brightness of their frames"},
      {"initializer.orb.semi_dense.line_error",
       "is gone: it is always the pose covariance across the epipolar line"},
      {"tracker.brightness", "is now the option 'brightness'"},
      {"tracker.huber_threshold", "is now the constant kHuberThreshold, 9 grey levels"},
      {"tracker.cutoff", "is now the constant kCutoff, 20 grey levels"},
      {"tracker.max_saturated_fraction", "is now the constant kMaxSaturatedFraction, 0.6"},
      {"tracker.abort_factor", "is now the constant kAbortFactor, 1.5"},
      {"tracker.accept_factor", "is now the constant kAcceptFactor, 1.5"},
      {"depth.epipolar.max_search_share", "is now the constant kMaxSearchShare, 0.027"},
      {"depth.epipolar.min_interval", "is now the constant kMinInterval, 1.5 px"},
      {"depth.epipolar.min_improvement", "is now the constant kMinImprovement, 2"},
      {"depth.epipolar.max_error", "is now the constant kMaxError, 10 px"},
      {"depth.epipolar.min_depth_ratio", "is now the constant kMinDepthRatio, 0.75"},
      {"depth.epipolar.max_depth_ratio", "is now the constant kMaxDepthRatio, 1.5"},
      {"depth.epipolar.refinement_iterations", "is now the constant kRefinementIterations, 3"},
      {"depth.epipolar.outlier_slack", "is now the constant kOutlierSlack, 1.2"},
      {"depth.activation.min_quality", "is now the constant kMinQuality, 3"},
      {"depth.activation.max_interval", "is now the constant kMaxInterval, 8 px"},
      {"depth.activation.initial_distance", "is now a constant, 2 px of half resolution"},
      {"depth.activation.max_distance",
       "is now the constant kMaxDistance, 4 px of half resolution"},
      {"depth.activation.iterations", "is now the constant kIterations, 3"},
      {"depth.activation.min_information",
       "is now the constant kMinInformation, 100 grey levels^2 unit^2"},
      {"depth.activation.min_observations", "is now the constant kMinObservations, 1"},
      {"window.brightness",
       "is now the option 'brightness'; free is uncalibrated, fixed is perfect"},
      {"window.min_information", "is now the constant kMinInformation, 50 grey levels^2 unit^2"},
      {"window.optimizer.max_iterations_small", "is now the constant kMaxIterationsSmall, 15"},
      {"window.optimizer.initial_damping", "is now the constant kInitialDamping, 1e-5"},
      {"window.optimizer.null_space_from", "is now the constant kNullSpaceFrom, 2"},
      {"window.optimizer.convergence", "is now the constant kSlack, 1.2"},
      {"window.prior.first_translation", "is now the constant kFirstTranslation, 1e10"},
      {"window.prior.first_rotation", "is now the constant kFirstRotation, 1e11"},
      {"window.prior.first_brightness", "is now the constant kFixedBrightness, 1e14"},
      {"window.prior.brightness_a", "is now the constant kCalibratedGain, 1e12"},
      {"window.prior.brightness_b", "is now the constant kCalibratedOffset, 1e8"},
      {"window.policy.translation_weight", "is now the constant kTranslationWeight, 44.8"},
      {"window.policy.full_weight", "is now the constant kFlowWeight, 22.4"},
      {"window.policy.brightness_weight", "is now the constant kBrightnessWeight, 2"},
      {"window.policy.rmse_ratio", "is now the constant kRmseRatio, 2"},
      {"window.policy.min_alive_share", "is now the constant kMinAliveShare, 0.05"},
      {"window.policy.max_log_gain", "is now the constant kMaxLogGain, 0.7"},
      {"window.policy.protect_first", "is gone: the first keyframe never leaves by distance"},
      {"probation.max_frames", "is now the constant kMaxFrames, 60"},
      {"initializer.coarse.density",
       "is gone: every level wants as many points as the published density gives"},
      {"initializer.coarse.prior_weight",
       "is now the constant kPriorWeight, 150 grey levels / unit"},
      {"initializer.coarse.prior_cap", "is now the constant kPriorCap, 2.5 grey levels"},
  };
  return keys;
}

const RetiredKey* findRetiredKey(const std::string& key) {
  const std::vector<RetiredKey>& keys = retiredKeys();
  auto found =
      std::find_if(keys.begin(), keys.end(), [&key](const auto& old) { return old.key == key; });
  if (found == keys.end()) {
    found = std::find_if(
        keys.begin(), keys.end(), [&key](const auto& old) { return isEndOfKey(key, old.key); });
  }
  return found == keys.end() ? nullptr : &*found;
}

}  // namespace dsorb::io
