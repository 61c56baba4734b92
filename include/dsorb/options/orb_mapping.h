// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/field.h"

namespace dsorb {

/// Robust loss of reprojection errors.
enum class RobustLoss { kHuber, kCauchy };

/// Options of the geometric bundle adjustment of ORBInitializer.
struct GeometricOptions {
  double sigma = 0.5;  ///< standard deviation of a corner's position, unless measured [px]
  RobustLoss loss = RobustLoss::kCauchy;  ///< of reprojection errors
  double loss_threshold = 1.5;            ///< of the whitened error, where the loss bends [-]
};

/// Field list; see DescribeFor.
template <typename Visitor, typename Options>
DescribeFor<Options, GeometricOptions> describe(Visitor& visit, Options& o) {
  visit.field("sigma", o.sigma, Range{0.01, 100}, "px");
  visit.choice("loss", o.loss, {{"huber", RobustLoss::kHuber}, {"cauchy", RobustLoss::kCauchy}});
  visit.field("loss_threshold", o.loss_threshold, Range{0.1, 1000}, "");
}

}  // namespace dsorb
