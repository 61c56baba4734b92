// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/field.h"

namespace dsorb {

/// What is free in the brightness of a frame; follows from what is known of the camera.
enum class BrightnessModel {
  kCalibrated,    ///< response and vignette known: brightness free, bounded absolutely
  kUncalibrated,  ///< raw grey levels: brightness free, bounded relative to the reference
  kPerfect        ///< rendered images: brightness fixed
};

/// Options of the direct tracker (coarse-to-fine pose and brightness of one frame).
struct TrackerOptions {
  BrightnessModel brightness = BrightnessModel::kUncalibrated;
  double huber_threshold = 9;           ///< [grey levels]
  double cutoff = 20;                   ///< larger residuals are saturated [grey levels]
  double max_saturated_fraction = 0.6;  ///< the cut-off is doubled while more points are saturated
  double abort_factor = 1.5;            ///< a hypothesis ends at a level worse than this x the best
  double accept_factor = 1.5;           ///< the search ends below this x the previous frame's rmse
  double min_inside_fraction = 0.3;     ///< of the reference points; below: lost
  double max_rmse = 12;                 ///< level 0; above: lost [grey levels]
};

template <typename Visitor, typename Options>
DescribeFor<Options, TrackerOptions> describe(Visitor& visit, Options& o) {
  visit.choice("brightness",
               o.brightness,
               {{"calibrated", BrightnessModel::kCalibrated},
                {"uncalibrated", BrightnessModel::kUncalibrated},
                {"perfect", BrightnessModel::kPerfect}});
  visit.field("huber_threshold", o.huber_threshold, Range{0.1, 255}, "grey levels");
  visit.field("cutoff", o.cutoff, Range{0.1, 255}, "grey levels");
  visit.field("max_saturated_fraction", o.max_saturated_fraction, Range{0, 1}, "");
  visit.field("abort_factor", o.abort_factor, Range{1, 100}, "");
  visit.field("accept_factor", o.accept_factor, Range{1, 100}, "");
  visit.field("min_inside_fraction", o.min_inside_fraction, Range{0, 1}, "");
  visit.field("max_rmse", o.max_rmse, Range{0.1, 1000}, "grey levels");
}

}  // namespace dsorb
