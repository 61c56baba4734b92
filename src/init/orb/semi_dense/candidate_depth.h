// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/orb_mapping.h"

#include "init/orb/semi_dense/corner_prior.h"

namespace dsorb::init_orb {

/// What the frames so far say about one candidate.
class CandidateDepth {
 public:
  CandidateDepth(const DepthEstimate& prior, DepthFusion fusion)
      : current_(prior), fusion_(fusion) {}

  [[nodiscard]] const DepthEstimate& current() const { return current_; }
  [[nodiscard]] int observations() const { return observations_; }
  [[nodiscard]] bool removed() const { return votes_ >= kMaxOutlierVotes; }

  /// Takes an observation in, or counts an outlier vote when it is outside the gate.
  /// @source Engel, Sturm, Cremers, ICCV 2013, section 2.3 (product of Gaussians)
  void add(const DepthEstimate& observed) {
    const float difference = observed.inverse_depth - current_.inverse_depth;
    const float sum = current_.variance + observed.variance;
    if (difference * difference > kFusionGate * kFusionGate * sum) {
      ++votes_;
      return;
    }
    if (fusion_ == DepthFusion::kProduct) {
      current_ = {(current_.variance * observed.inverse_depth +
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

  DepthEstimate current_;
  DepthFusion fusion_;
  int observations_ = 0;
  int votes_ = 0;
};

}  // namespace dsorb::init_orb
