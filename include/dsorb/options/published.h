// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/field.h"

#include <algorithm>
#include <array>
#include <string>

namespace dsorb {

/// Names of the published variants, which dsorb::published makes known.
constexpr std::array<const char*, 4> kPublishedVariants = {
    "orb-v1", "orb-v2", "orb-v3", "orb-matching"};
/// Whether a name is one of kPublishedVariants.
inline bool isPublishedVariant(const std::string& name) {
  return std::find(kPublishedVariants.begin(), kPublishedVariants.end(), name) !=
         kPublishedVariants.end();
}

/// Options of the published variants; all else is as in the thesis.
struct PublishedOptions {
  int min_frames = 5;      ///< before the first attempt, including the reference
  int max_frames = 20;     ///< after which the reference is given up
  int min_tracked = 50;    ///< tracks below which the reference is given up
  int max_corners = 2000;  ///< of the reference
};

/// Field list; see DescribeFor.
template <typename Visitor, typename Options>
DescribeFor<Options, PublishedOptions> describe(Visitor& visit, Options& o) {
  visit.field("min_frames", o.min_frames, Range{2, 100}, "frames");
  visit.field("max_frames", o.max_frames, Range{2, 1000}, "frames");
  visit.field("min_tracked", o.min_tracked, Range{8, 20000}, "corners");
  visit.field("max_corners", o.max_corners, Range{50, 20000}, "corners");
}

}  // namespace dsorb
