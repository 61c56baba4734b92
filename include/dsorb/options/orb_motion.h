// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/field.h"

namespace dsorb {

/// How ORBInitializer finds poses and corners.
enum class MotionMethod {
  kReport,   ///< homography against fundamental matrix, gates on the number of frames and points
  kInformed  ///< essential matrix and adjustment, gate on the predicted error of the direction
};

/// What a start must show before it is believed.
/// @source measured on 5250 windows: of all numbers tried the predicted error of the direction of
///         translation tells right starts from wrong ones best. The limits are in the ranges in
///         which no measured sequence leaves its bounds (cars, drone, hands): predicted sigma 0.90
///         to 0.99, fitted sigma 0.25 to 0.27 (0.24: fewer starts), parallax 1.5 to 1.6 (1.4:
///         worse depths), sharp sigma 0.35 to 0.5, sharp parallax 0.85 to 0.95
struct GateOptions {
  int min_points = 60;                    ///< corners left after the adjustment
  double min_track_share = 0.5;           ///< of the reference's live tracks they must be
  double min_front_share = 0.8;           ///< of them, in front of the camera
  double max_direction_sigma_deg = 0.95;  ///< predicted, as if 100 corners had been seen
  double max_fitted_sigma_deg = 0.25;     ///< the same from the residuals as they are
  double min_parallax_deg = 1.5;          ///< median angle under which both cameras see a corner
  double sharp_sigma_deg = 0.35;          ///< predicted, up to it sharp_parallax_deg is enough
  double sharp_parallax_deg = 0.9;        ///< wide views tell the direction before the depths
};

template <typename Visitor, typename Options>
DescribeFor<Options, GateOptions> describe(Visitor& visit, Options& o) {
  visit.field("min_points", o.min_points, Range{8, 100000}, "points");
  visit.field("min_track_share", o.min_track_share, Range{0, 1}, "");
  visit.field("min_front_share", o.min_front_share, Range{0, 1}, "");
  visit.field("max_direction_sigma_deg", o.max_direction_sigma_deg, Range{0, 180}, "deg");
  visit.field("max_fitted_sigma_deg", o.max_fitted_sigma_deg, Range{0, 180}, "deg");
  visit.field("min_parallax_deg", o.min_parallax_deg, Range{0, 90}, "deg");
  visit.field("sharp_sigma_deg", o.sharp_sigma_deg, Range{0, 180}, "deg");
  visit.field("sharp_parallax_deg", o.sharp_parallax_deg, Range{0, 90}, "deg");
}

/// Corners are measured again with the patch of the reference, warped by pose and inverse depth.
struct PolishOptions {
  int rounds = 5;               ///< of measuring and adjusting; 0: no polish
  int iterations = 2;           ///< of the adjustment in each round; 2 to 6 give the same starts
  double cauchy_threshold = 2;  ///< of the whitened error [-]
  double huber_threshold = 9;   ///< of a pixel's residual [grey levels]
  double max_step = 1;          ///< of one corner in one round [px]
  double max_residual = 25;     ///< mean of a patch; more: the corner is dropped [grey levels]
  double image_noise = 2.8284;  ///< of one grey value, as in the epipolar search [grey levels]
  double min_sigma = 0.05;      ///< of a corner however strong its gradients [px]
  double max_turn_deg = 15;  ///< of the direction of translation; more: the polish is not believed
};

template <typename Visitor, typename Options>
DescribeFor<Options, PolishOptions> describe(Visitor& visit, Options& o) {
  visit.field("rounds", o.rounds, Range{0, 100}, "rounds");
  visit.field("iterations", o.iterations, Range{1, 1000}, "iterations");
  visit.field("cauchy_threshold", o.cauchy_threshold, Range{0.1, 1000}, "");
  visit.field("huber_threshold", o.huber_threshold, Range{0.1, 255}, "grey levels");
  visit.field("max_step", o.max_step, Range{0.01, 100}, "px");
  visit.field("max_residual", o.max_residual, Range{0.1, 255}, "grey levels");
  visit.field("image_noise", o.image_noise, Range{0.01, 255}, "grey levels");
  visit.field("min_sigma", o.min_sigma, Range{0.001, 10}, "px");
  visit.field("max_turn_deg", o.max_turn_deg, Range{0, 180}, "deg");
}

/// Motion from the essential matrix, decided on by what is known of it.
struct InformedOptions {
  int min_tracks = 50;                 ///< of a reference, before an attempt
  double min_rotation_residual = 0.5;  ///< median that a rotation leaves; less: no parallax [px]
  double ransac_threshold = 1;         ///< distance from the epipolar line [px]
  int max_rounds = 1000;               ///< of RANSAC; it stops when it is sure
  int min_inliers = 50;
  bool name_models = true;            ///< rotation and homography compete with the essential matrix
  double min_track_noise = 0.5;       ///< in that competition, however well the tracks fit [px]
  bool try_planes = true;             ///< both motions of a plane compete over all frames
  double min_plane_cost_ratio = 1.2;  ///< of the second-best motion of a plane; less: undecided [-]
  GateOptions gate;
  /// An attempt is left out where the last one from this reference, extrapolated by the growth of
  /// the parallax, misses the gate by more than this factor.
  double hope = 1.25;
  int max_skipped_frames = 2;  ///< but so many times in a row at most
  int noise_rounds = 3;  ///< of measuring the tracks' noise from the residuals; 0: it is given
  PolishOptions polish;
};

template <typename Visitor, typename Options>
DescribeFor<Options, InformedOptions> describe(Visitor& visit, Options& o) {
  visit.field("min_tracks", o.min_tracks, Range{8, 20000}, "corners");
  visit.field("min_rotation_residual", o.min_rotation_residual, Range{0, 100}, "px");
  visit.field("ransac_threshold", o.ransac_threshold, Range{0.01, 100}, "px");
  visit.field("max_rounds", o.max_rounds, Range{1, 100000}, "rounds");
  visit.field("min_inliers", o.min_inliers, Range{8, 20000}, "corners");
  visit.field("name_models", o.name_models);
  visit.field("min_track_noise", o.min_track_noise, Range{0.01, 100}, "px");
  visit.field("try_planes", o.try_planes);
  visit.field("min_plane_cost_ratio", o.min_plane_cost_ratio, Range{1, 1000}, "");
  visit.group("gate", o.gate);
  visit.field("hope", o.hope, Range{1, 1000}, "");
  visit.field("max_skipped_frames", o.max_skipped_frames, Range{0, 1000}, "frames");
  visit.field("noise_rounds", o.noise_rounds, Range{0, 100}, "rounds");
  visit.group("polish", o.polish);
}

}  // namespace dsorb
