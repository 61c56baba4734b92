// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/orb_mapping.h"

#include "init/orb/semi_dense/corner_prior.h"

namespace dsorb::init_orb {

/// What the frames so far say about one candidate.
class CandidateDepth {
 public:
  CandidateDepth(const DepthEstimate& prior, const SemiDenseOptions& options)
      : current_(prior), options_(options) {}

  [[nodiscard]] const DepthEstimate& current() const { return current_; }
  [[nodiscard]] int observations() const { return observations_; }
  [[nodiscard]] bool removed() const { return votes_ >= options_.max_outlier_votes; }

  /// Takes an observation in, or counts an outlier vote when it is outside the gate.
  /// @source Engel, Sturm, Cremers, ICCV 2013, section 2.3 (product of Gaussians)
  void add(const DepthEstimate& observed) {
    const float difference = observed.inverse_depth - current_.inverse_depth;
    const float sum = current_.variance + observed.variance;
    const auto gate = static_cast<float>(options_.fusion_gate);
    if (difference * difference > gate * gate * sum) {
      ++votes_;
      return;
    }
    if (options_.fusion == DepthFusion::kProduct) {
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
  DepthEstimate current_;
  const SemiDenseOptions& options_;
  int observations_ = 0;
  int votes_ = 0;
};

}  // namespace dsorb::init_orb
