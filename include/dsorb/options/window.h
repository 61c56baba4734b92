// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/field.h"

namespace dsorb {

/// What is known of the brightness of frames.
enum class BrightnessMode {
  kFree,        ///< no calibration: a and b of every frame are estimated freely
  kCalibrated,  ///< exposure and response are known: a and b have priors at 0
  kFixed        ///< perfect images: a = b = 0
};

/// Iteration of the windowed adjustment.
struct OptimizerOptions {
  int max_iterations = 6;
  int max_iterations_small = 15;  ///< while the window has fewer than 4 keyframes
  double initial_damping = 1e-5;  ///< of the diagonal
  bool undo_bad_steps = true;     ///< false (reference): every step is kept, damping is constant
  bool fixed_thresholds = true;  ///< false (reference): outlier limit changes with every evaluation
  bool optimize_intrinsics = false;  ///< reference: true
  int null_space_from = 2;           ///< first iteration whose step has gauge motion removed
  double convergence = 1.2;          ///< factor on the limits of a step that ends the iteration
};

template <typename Visitor, typename Options>
DescribeFor<Options, OptimizerOptions> describe(Visitor& visit, Options& o) {
  visit.field("max_iterations", o.max_iterations, Range{1, 1000}, "iterations");
  visit.field("max_iterations_small", o.max_iterations_small, Range{1, 1000}, "iterations");
  visit.field("initial_damping", o.initial_damping, Range{0, 1e6}, "");
  visit.field("undo_bad_steps", o.undo_bad_steps);
  visit.field("fixed_thresholds", o.fixed_thresholds);
  visit.field("optimize_intrinsics", o.optimize_intrinsics);
  visit.field("null_space_from", o.null_space_from, Range{0, 1000}, "iterations");
  visit.field("convergence", o.convergence, Range{0, 1000}, "");
}

/// Weights of the priors. Frames and intrinsics in scaled units (window/window.h).
struct PriorOptions {
  double first_translation = 1e10;  ///< first keyframe, holds the gauge
  double first_rotation = 1e11;
  double first_brightness = 1e14;
  double brightness_a = 1e12;  ///< further keyframes, calibrated mode
  double brightness_b = 1e8;
  double intrinsics = 5e9;
  double depth_gain = 1;                     ///< on 1 / variance of an initial point
  double max_depth = 2500;                   ///< upper limit of an initial point's prior
  bool depth_pulls_to_value = true;          ///< false (reference): the depth prior only damps
  double depth_at_marginalization = 360000;  ///< factor on the depth prior, 600^2
  bool consistent_gradient = true;  ///< false (reference): a marginalised prior's gradient is
                                    ///< taken at the current state instead of the expansion point
};

template <typename Visitor, typename Options>
DescribeFor<Options, PriorOptions> describe(Visitor& visit, Options& o) {
  visit.field("first_translation", o.first_translation, Range{0, 1e16}, "");
  visit.field("first_rotation", o.first_rotation, Range{0, 1e16}, "");
  visit.field("first_brightness", o.first_brightness, Range{0, 1e16}, "");
  visit.field("brightness_a", o.brightness_a, Range{0, 1e16}, "");
  visit.field("brightness_b", o.brightness_b, Range{0, 1e16}, "");
  visit.field("intrinsics", o.intrinsics, Range{0, 1e16}, "");
  visit.field("depth_gain", o.depth_gain, Range{0, 1e9}, "grey levels^2");
  visit.field("max_depth", o.max_depth, Range{0, 1e12}, "grey levels^2 unit^2");
  visit.field("depth_pulls_to_value", o.depth_pulls_to_value);
  visit.field("depth_at_marginalization", o.depth_at_marginalization, Range{1, 1e9}, "");
  visit.field("consistent_gradient", o.consistent_gradient);
}

/// When a keyframe is added and which one leaves.
struct KeyframePolicyOptions {
  double translation_weight =
      44.8;                       ///< of the flow by translation over width + height; 0.04 * 1120
  double full_weight = 22.4;      ///< of the whole flow over width + height; 0.02 * 1120
  double brightness_weight = 2;   ///< of the absolute log gain
  double frequency = 1;           ///< factor on all three
  double rmse_ratio = 2;          ///< of the tracking error to that of the first frame
  double per_second = 0;          ///< fixed rate instead; 0: off
  double min_alive_share = 0.05;  ///< a keyframe with fewer of its points left leaves
  double max_log_gain = 0.7;      ///< to the newest keyframe; more leaves
  bool protect_first = true;      ///< the first keyframe never leaves by distance
};

template <typename Visitor, typename Options>
DescribeFor<Options, KeyframePolicyOptions> describe(Visitor& visit, Options& o) {
  visit.field("translation_weight", o.translation_weight, Range{0, 1e4}, "");
  visit.field("full_weight", o.full_weight, Range{0, 1e4}, "");
  visit.field("brightness_weight", o.brightness_weight, Range{0, 1e4}, "");
  visit.field("frequency", o.frequency, Range{0, 100}, "");
  visit.field("rmse_ratio", o.rmse_ratio, Range{1, 1e6}, "");
  visit.field("per_second", o.per_second, Range{0, 1000}, "1/s");
  visit.field("min_alive_share", o.min_alive_share, Range{0, 1}, "");
  visit.field("max_log_gain", o.max_log_gain, Range{0, 10}, "");
  visit.field("protect_first", o.protect_first);
}

/// The window of keyframes and its adjustment.
struct WindowOptions {
  int min_keyframes = 5;
  int max_keyframes = 7;  ///< after marginalisation; one more while optimising
  int first_keyframes =
      4;  ///< made of the frames of an initialization, as far as it has posed them
  int desired_points = 2000;
  BrightnessMode brightness = BrightnessMode::kFree;
  double marginalization_weight = 0.25;  ///< of newly marginalised information
  double min_information = 50;           ///< of a depth worth marginalising [grey^2 unit^2]
  bool current_reference = true;  ///< false (reference): tracking depths use first-estimate poses
  OptimizerOptions optimizer;
  PriorOptions prior;
  KeyframePolicyOptions policy;
};

template <typename Visitor, typename Options>
DescribeFor<Options, WindowOptions> describe(Visitor& visit, Options& o) {
  visit.field("min_keyframes", o.min_keyframes, Range{2, 10}, "keyframes");
  visit.field("max_keyframes", o.max_keyframes, Range{2, 10}, "keyframes");
  visit.field("first_keyframes", o.first_keyframes, Range{2, 10}, "keyframes");
  visit.field("desired_points", o.desired_points, Range{10, 100000}, "points");
  visit.choice("brightness",
               o.brightness,
               {{"free", BrightnessMode::kFree},
                {"calibrated", BrightnessMode::kCalibrated},
                {"fixed", BrightnessMode::kFixed}});
  visit.field("marginalization_weight", o.marginalization_weight, Range{0, 1}, "");
  visit.field("min_information", o.min_information, Range{0, 1e9}, "grey levels^2 unit^2");
  visit.field("current_reference", o.current_reference);
  visit.group("optimizer", o.optimizer);
  visit.group("prior", o.prior);
  visit.group("policy", o.policy);
}

}  // namespace dsorb
