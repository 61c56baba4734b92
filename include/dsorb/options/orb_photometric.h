// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/field.h"

namespace dsorb {

/// Who minimises the photometric errors; both to the same minimum.
enum class PhotometricSolver {
  kCeres,
  kSchur  ///< our own normal equations, about ten times faster
};

/// How the brightness of a patch in two frames is made equal.
enum class PhotometricBrightness {
  kPsiFixed,  ///< times the ratio psi of the patch sums, its derivative ignored, as the report
  kAffine     ///< one pair (a, b) a frame as unknowns
};

/// What becomes of the poses that the corners gave.
enum class PhotometricPoses {
  kFree,  ///< adjusted with the inverse depths
  kGated  ///< adjusted where corners are few, but kept when they would move farther than their
          ///< covariance allows; where they are kept, every inverse depth is refined on its own
};

/// Options of the photometric bundle adjustment of ORBInitializer.
struct PhotometricOptions {
  bool enabled = true;
  PhotometricSolver solver = PhotometricSolver::kSchur;
  PhotometricBrightness brightness = PhotometricBrightness::kAffine;
  PhotometricPoses poses = PhotometricPoses::kGated;
  double max_pose_move = 5;  ///< of the gate: largest move of the target's direction [sigma]
  /// Of the gate: corners that make the geometric poses the better ones. Measured: with 160 corners
  /// (TartanAir) the direction gains .2 deg, with 300 and more (KITTI, EuRoC, rendered) it loses
  /// .02 to .1 deg.
  int enough_corners = 250;
  double huber_threshold = 9;        ///< of one pixel [grey levels]
  bool gradient_weights = true;      ///< strong gradients count less
  int max_frames = 4;                ///< evenly spaced, the newest included
  int max_iterations = 4;            ///< of one solve
  double function_tolerance = 1e-6;  ///< relative change of the cost that ends a solve [-]
  double coarse_residual = 20;    ///< a coarser level comes first above this median [grey levels]
  int joint_points = 500;         ///< best points that give the poses, beside the corners; 0: all
  int depth_iterations = 3;       ///< of the other points, poses fixed
  double min_inside_share = 0.5;  ///< of the residuals; fewer inside the images: failed
  bool variances = true;  ///< replace those of the search by those of the photometric equations
  double pose_variance_factor = 6;  ///< on the clustered covariance of photometric poses [-]
  double match_error = 0.1;         ///< error that all frames share, along a gradient [px]
};

template <typename Visitor, typename Options>
DescribeFor<Options, PhotometricOptions> describe(Visitor& visit, Options& o) {
  visit.field("enabled", o.enabled);
  visit.choice("solver",
               o.solver,
               {{"ceres", PhotometricSolver::kCeres}, {"schur", PhotometricSolver::kSchur}});
  visit.choice("brightness",
               o.brightness,
               {{"psi_fixed", PhotometricBrightness::kPsiFixed},
                {"affine", PhotometricBrightness::kAffine}});
  visit.choice(
      "poses", o.poses, {{"free", PhotometricPoses::kFree}, {"gated", PhotometricPoses::kGated}});
  visit.field("max_pose_move", o.max_pose_move, Range{0, 1000}, "sigma");
  visit.field("enough_corners", o.enough_corners, Range{0, 1000000}, "corners");
  visit.field("huber_threshold", o.huber_threshold, Range{0.1, 1000}, "grey levels");
  visit.field("gradient_weights", o.gradient_weights);
  visit.field("max_frames", o.max_frames, Range{1, 16}, "frames");
  visit.field("max_iterations", o.max_iterations, Range{1, 1000}, "iterations");
  visit.field("function_tolerance", o.function_tolerance, Range{1e-16, 1}, "");
  visit.field("coarse_residual", o.coarse_residual, Range{0, 1000}, "grey levels");
  visit.field("joint_points", o.joint_points, Range{0, 100000}, "points");
  visit.field("depth_iterations", o.depth_iterations, Range{1, 100}, "iterations");
  visit.field("min_inside_share", o.min_inside_share, Range{0, 1}, "");
  visit.field("variances", o.variances);
  visit.field("pose_variance_factor", o.pose_variance_factor, Range{0, 10000}, "");
  visit.field("match_error", o.match_error, Range{0, 100}, "px");
}

/// Which rule removes points after the photometric adjustment.
enum class OutlierRule {
  kNone,
  kPixelVotes,  ///< the report's: pixels outside a quantile of the t-distribution
  kCombined     ///< predicted sigma, disagreement with neighbours, mean t-weight
};

/// Options of the outlier filter of ORBInitializer.
struct OutlierOptions {
  OutlierRule rule = OutlierRule::kCombined;
  double prefilter = 3;       ///< residuals beyond do not enter the t-fit [1.4826 MAD]
  double t_quantile = 2.571;  ///< pixel votes: cut, keeps 95 % (5 degrees of freedom) [t-scale]
  int min_observations = 2;   ///< pixel votes: frames a point needs; fewer where fewer were given
  double max_relative_sigma = 0.15;  ///< combined: predicted sigma over inverse depth [-]
  double max_disagreement = 0.25;  ///< combined: difference of log inverse depth to neighbours [-]
  double min_t_weight = 0.5;       ///< combined: mean over the pixels [-]
};

template <typename Visitor, typename Options>
DescribeFor<Options, OutlierOptions> describe(Visitor& visit, Options& o) {
  visit.choice("rule",
               o.rule,
               {{"none", OutlierRule::kNone},
                {"pixel_votes", OutlierRule::kPixelVotes},
                {"combined", OutlierRule::kCombined}});
  visit.field("prefilter", o.prefilter, Range{0.1, 1000}, "MAD");
  visit.field("t_quantile", o.t_quantile, Range{0.1, 1000}, "t-scale");
  visit.field("min_observations", o.min_observations, Range{1, 100}, "frames");
  visit.field("max_relative_sigma", o.max_relative_sigma, Range{0.001, 1000}, "");
  visit.field("max_disagreement", o.max_disagreement, Range{0.001, 1000}, "");
  visit.field("min_t_weight", o.min_t_weight, Range{0, 1}, "");
}

}  // namespace dsorb
