// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/brightness.h"
#include "dsorb/options/depth.h"
#include "dsorb/options/initializer.h"
#include "dsorb/options/tracker.h"
#include "dsorb/options/window.h"

namespace dsorb {

/// Limits of the residual's root mean square after the adjustment of the first keyframes, beyond
/// which a start is taken back. @source DSO as published, unless noted
struct ProbationOptions {
  double max_rms_second = 20;  ///< [grey levels]
  double max_rms_third = 13;   ///< [grey levels]
  /// [grey levels]. The published limit is 9, which on KITTI 00 reversed from frame 199 refused
  /// eight starts in a row at 9.2 to 9.7 that were as accurate as the one it accepted (path error
  /// 0.9 % both ways).
  double max_rms_fourth = 11;
  /// Whether a loss during probation takes the start back, once in a segment. The second loss, or
  /// every one without this option, is a loss like any other.
  bool includes_loss = true;
};

template <typename Visitor, typename Options>
DescribeFor<Options, ProbationOptions> describe(Visitor& visit, Options& o) {
  visit.field("max_rms_second", o.max_rms_second, Range{0, 1e4}, "grey levels");
  visit.field("max_rms_third", o.max_rms_third, Range{0, 1e4}, "grey levels");
  visit.field("max_rms_fourth", o.max_rms_fourth, Range{0, 1e4}, "grey levels");
  visit.field("includes_loss", o.includes_loss);
}

struct OdometryOptions {
  int num_threads = 1;  ///< 0: all the machine has; replaces initializer.num_threads
  /// Mapping in a thread of its own, beside tracking, as live use needs: frames are tracked against
  /// the newest keyframe that is finished, so results depend on timing. Each side has num_threads.
  bool pipelined = false;
  /// Number of tracked frames that may wait for mapping before tracking waits. Frames that are
  /// tracked while a keyframe is made use the one before it, which costs accuracy.
  int max_waiting = 2;
  BrightnessModel brightness = BrightnessModel::kUncalibrated;
  InitializerOptions initializer;
  TrackerOptions tracker;
  DepthOptions depth;
  WindowOptions window;
  ProbationOptions probation;
};

template <typename Visitor, typename Options>
DescribeFor<Options, OdometryOptions> describe(Visitor& visit, Options& o) {
  visit.field("num_threads", o.num_threads, Range{0, 1024}, "threads");
  visit.field("pipelined", o.pipelined);
  visit.field("max_waiting", o.max_waiting, Range{1, 1000}, "frames");
  visit.choice("brightness",
               o.brightness,
               {{"uncalibrated", BrightnessModel::kUncalibrated},
                {"calibrated", BrightnessModel::kCalibrated},
                {"perfect", BrightnessModel::kPerfect}});
  visit.group("initializer", o.initializer);
  visit.group("tracker", o.tracker);
  visit.group("depth", o.depth);
  visit.group("window", o.window);
  visit.group("probation", o.probation);
}

}  // namespace dsorb
