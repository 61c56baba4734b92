// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/brightness.h"
#include "dsorb/options/depth.h"
#include "dsorb/options/initializer.h"
#include "dsorb/options/tracker.h"
#include "dsorb/options/window.h"

namespace dsorb {

/// All options of Odometry.
struct OdometryOptions {
  int num_threads = 1;  ///< 0: all the machine has; replaces initializer.num_threads
  /// Mapping in a thread of its own, beside tracking, as live use needs: frames are tracked against
  /// the newest keyframe that is finished, so results depend on timing. Each side has num_threads.
  bool pipelined = false;
  /// Number of tracked frames that may wait for mapping before tracking waits. Frames that are
  /// tracked while a keyframe is made use the one before it, which costs accuracy.
  int max_waiting = 2;
  /// Starts in a row that the window may refuse; the next one that it can adjust stays. 0: all do.
  int max_refusals = 2;
  /// Frames in a row that may stay without a pose (black, torn, covered for a moment) while the map
  /// stands, those with a pose that does not fit counted; the next one loses it. 0: the first does.
  int max_missed = 3;
  BrightnessModel brightness = BrightnessModel::kUncalibrated;  ///< what is known of the images
  InitializerOptions initializer;                               ///< first poses and depths
  TrackerOptions tracker;                                       ///< pose of each frame
  DepthOptions depth;                                           ///< of candidate points
  WindowOptions window;                                         ///< of keyframes
};

/// Field list; see DescribeFor.
template <typename Visitor, typename Options>
DescribeFor<Options, OdometryOptions> describe(Visitor& visit, Options& o) {
  visit.field("num_threads", o.num_threads, Range{0, 1024}, "threads");
  visit.field("pipelined", o.pipelined);
  visit.field("max_waiting", o.max_waiting, Range{1, 1000}, "frames");
  visit.field("max_refusals", o.max_refusals, Range{0, 1000000}, "starts");
  visit.field("max_missed", o.max_missed, Range{0, 1000}, "frames");
  visit.choice("brightness",
               o.brightness,
               {{"uncalibrated", BrightnessModel::kUncalibrated},
                {"calibrated", BrightnessModel::kCalibrated},
                {"perfect", BrightnessModel::kPerfect}});
  visit.group("initializer", o.initializer);
  visit.group("tracker", o.tracker);
  visit.group("depth", o.depth);
  visit.group("window", o.window);
}

}  // namespace dsorb
