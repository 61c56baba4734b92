// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/field.h"

namespace dsorb {

/// Parts of the image that move by themselves: there the tracks contradict the camera's motion.
struct MovingPartsOptions {
  bool remove = true;            ///< points among such tracks
  double min_error = 1;          ///< rms over the frames from which a track may contradict [px]
  double error_factor = 5;       ///< and by which it exceeds the median of all tracks [-]
  int neighbours = 5;            ///< nearest tracks that vote on a point
  double radius = 60;            ///< tracks farther away do not vote [px]
  double max_share = 0.4;        ///< of contradicting neighbours that a point may have
  double min_found_share = 0.7;  ///< of the epipolar searches of a point that agree on its depth
};

template <typename Visitor, typename Options>
DescribeFor<Options, MovingPartsOptions> describe(Visitor& visit, Options& o) {
  visit.field("remove", o.remove);
  visit.field("min_error", o.min_error, Range{0, 100}, "px");
  visit.field("error_factor", o.error_factor, Range{0, 1000}, "");
  visit.field("neighbours", o.neighbours, Range{1, 32}, "tracks");
  visit.field("radius", o.radius, Range{1, 100000}, "px");
  visit.field("max_share", o.max_share, Range{0, 1}, "");
  visit.field("min_found_share", o.min_found_share, Range{0, 1}, "");
}

}  // namespace dsorb
