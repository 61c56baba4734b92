// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/init/report.h"
#include "dsorb/options/orb_mapping.h"

#include "init/orb/map/initial_map.h"

#include <cstdint>
#include <functional>

namespace dsorb::init_orb {

/// Estimate of one candidate from the frames so far.
class CandidateDepth {
 public:
  CandidateDepth(const SemiDensePoint& prior, DepthFusion fusion)
      : current_(prior), fusion_(fusion) {}

  [[nodiscard]] const SemiDensePoint& current() const { return current_; }
  [[nodiscard]] int observations() const { return observations_; }
  [[nodiscard]] bool removed() const { return votes_ >= kMaxOutlierVotes; }

  /// Takes an observation in, or counts an outlier vote when it is outside the gate.
  /// @source Engel, Sturm, Cremers, ICCV 2013, section 2.3 (product of Gaussians)
  void add(const SemiDensePoint& observed) {
    const float difference = observed.inverse_depth - current_.inverse_depth;
    const float sum = current_.variance + observed.variance;
    if (difference * difference > kFusionGate * kFusionGate * sum) {
      ++votes_;
      return;
    }
    if (fusion_ == DepthFusion::kProduct) {
      current_ = {current_.pixel,
                  (current_.variance * observed.inverse_depth +
                   observed.variance * current_.inverse_depth) /
                      sum,
                  current_.variance * observed.variance / sum};
    } else if (observations_ == 0 || observed.variance < current_.variance) {
      current_ = observed;  // the prior, made of neighbours, yields to any observation
    }
    ++observations_;
  }

 private:
  static constexpr float kFusionGate = 3;     // farther from the prior: a vote [combined sigma]
  static constexpr int kMaxOutlierVotes = 3;  // so many remove a point

  SemiDensePoint current_;
  DepthFusion fusion_;
  int observations_ = 0;
  int votes_ = 0;
};

/// What the caller knows of the inverse depth at a pixel of the reference, in the map's unit;
/// empty: nothing anywhere.
using KnownDepths = std::function<KnownInverseDepth(const Eigen::Vector2f&)>;

/// Sets the frames' brightness and `map.points`: selects gradient pixels of the reference, searches
/// each along its epipolar line in every later posed frame and fuses what is found to one inverse
/// depth with variance. Runs in parallel inside the caller's arena; the result does not depend on
/// the number of threads.
/// @param map adjusted: poses, covariances, corners with variances; mean inverse depth 1
/// @param seed  of the random choice among too many candidates
/// @param known safe to call from several threads
/// @source Engel, Sturm, Cremers, Semi-Dense Visual Odometry for a Monocular Camera, ICCV 2013
SemiDenseReport estimateSemiDenseDepth(InitialMap& map,
                                       const PinholeCamera& camera,
                                       const SemiDenseOptions& options,
                                       std::uint64_t seed,
                                       const KnownDepths& known = {});

/// Keeps the points of smallest relative variance, so that corners and points are no more than
/// wanted.
void keepBestPoints(InitialMap& map, int wanted);

}  // namespace dsorb::init_orb
