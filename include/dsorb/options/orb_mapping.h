// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/field.h"

namespace dsorb {

/// Who minimises the reprojection errors; both to the same minimum.
enum class GeometricSolver {
  kCeres,
  kSchur  ///< our own normal equations, many times faster at this size
};

/// How little large reprojection errors count.
enum class RobustLoss { kHuber, kCauchy };

/// Options of the geometric bundle adjustment of ORBInitializer.
struct GeometricOptions {
  GeometricSolver solver = GeometricSolver::kSchur;
  double sigma = 0.5;  ///< standard deviation of a corner's position, unless measured [px]
  RobustLoss loss = RobustLoss::kCauchy;
  double loss_threshold = 1.5;  ///< of the whitened error, where the loss bends [-]
  double severe_limit = 8.0;  ///< a corner above it in any frame goes, and all is solved again [px]
  double normal_limit = 3.0;  ///< limit after the severe outliers are gone [px]
  double limit_factor = 4;    ///< informed motion: limit in robust standard deviations, between
                              ///< first_limit or normal_limit and severe_limit [-]
  double first_limit = 6;     ///< informed motion: least limit after the first solution [px]
  int max_frames = 6;         ///< informed motion: evenly spread frames adjusted, both ends too
  int min_points = 50;        ///< fewer corners left: the attempt fails
  int max_iterations = 20;    ///< of one solve
  int max_rounds = 10;        ///< of solving and removing severe outliers
  double function_tolerance = 1e-6;  ///< relative change of the cost that ends a solve [-]
  /// On the clustered covariance of the poses [-]; 0: formal covariances, every observation counts.
  double pose_variance_factor = 1;
  /// What that factor grows by, as a share of itself, where the errors' tails are in excess by 1
  /// [-]. With 1 and 4 the median of error^2 over variance is .45 and .49 (rotation, direction)
  /// over 18 rendered sequences, .15 to 1.6 on each; .55, .51 on TartanAir and .37, .34 on
  /// room_hand.
  double tail_variance_factor = 4;
};

template <typename Visitor, typename Options>
DescribeFor<Options, GeometricOptions> describe(Visitor& visit, Options& o) {
  visit.choice(
      "solver", o.solver, {{"ceres", GeometricSolver::kCeres}, {"schur", GeometricSolver::kSchur}});
  visit.field("sigma", o.sigma, Range{0.01, 100}, "px");
  visit.choice("loss", o.loss, {{"huber", RobustLoss::kHuber}, {"cauchy", RobustLoss::kCauchy}});
  visit.field("loss_threshold", o.loss_threshold, Range{0.1, 1000}, "");
  visit.field("severe_limit", o.severe_limit, Range{0.1, 1000}, "px");
  visit.field("normal_limit", o.normal_limit, Range{0.1, 1000}, "px");
  visit.field("limit_factor", o.limit_factor, Range{0, 1000}, "");
  visit.field("first_limit", o.first_limit, Range{0.1, 1000}, "px");
  visit.field("max_frames", o.max_frames, Range{2, 1000}, "frames");
  visit.field("min_points", o.min_points, Range{8, 100000}, "points");
  visit.field("max_iterations", o.max_iterations, Range{1, 1000}, "iterations");
  visit.field("max_rounds", o.max_rounds, Range{1, 100}, "rounds");
  visit.field("function_tolerance", o.function_tolerance, Range{1e-16, 1}, "");
  visit.field("pose_variance_factor", o.pose_variance_factor, Range{0, 10000}, "");
  visit.field("tail_variance_factor", o.tail_variance_factor, Range{0, 10000}, "");
}

/// How several observations of one inverse depth become one.
enum class DepthFusion {
  kProduct,     ///< product of Gaussians
  kMostPrecise  ///< the observation of smallest variance: all share the reference patch
};

/// Options of the semi-dense structure of ORBInitializer.
struct SemiDenseOptions {
  int patch_size = 6;                ///< one candidate in a square of this side [px]
  double gradient_above_median = 7;  ///< threshold over the median of its 32x32 block [grey/px]
  int max_candidates = 3000;         ///< larger patches are taken until no more remain
  double min_gradient_share = 0.3;   ///< least |gradient along the line| / |gradient| [-]
  double min_line_gradient = 2.0;    ///< least |gradient along the line| [grey/px]
  int prior_neighbours = 5;          ///< nearest corners a prior is made of
  double prior_radius = 60;          ///< corners farther away do not count [px]
  double min_prior_sigma = 0.1;      ///< of a prior, relative to its inverse depth [-]
  double search_sigmas = 2.0;        ///< half length of the searched interval [sigma]
  double max_search = 0.25;          ///< longest search [image diagonals]
  double image_noise = 2.8284;       ///< of one grey value, sigma_i: sqrt(8) [grey levels]
  double max_residual =
      16;  ///< largest rms of a matched patch [grey levels]; LSD: 1300 over 5 samples
  double second_best_ratio = 1.5;  ///< least ratio of the second-best minimum to the best [-]
  double line_error_floor = 0.2;   ///< least sigma_l [px]
  DepthFusion fusion = DepthFusion::kMostPrecise;
  double fusion_gate = 3.0;   ///< farther from the prior is an outlier vote [combined sigma]
  int max_outlier_votes = 3;  ///< so many votes remove a point
  int min_points = 50;        ///< fewer: the attempt fails
  /// Corners and points together that are adjusted and handed over, those of smallest relative
  /// variance; 0: all. As many as the window takes.
  int max_points = 2000;
};

template <typename Visitor, typename Options>
DescribeFor<Options, SemiDenseOptions> describe(Visitor& visit, Options& o) {
  visit.field("patch_size", o.patch_size, Range{1, 1000}, "px");
  visit.field("gradient_above_median", o.gradient_above_median, Range{0, 255}, "grey levels / px");
  visit.field("max_candidates", o.max_candidates, Range{1, 1000000}, "points");
  visit.field("min_gradient_share", o.min_gradient_share, Range{0, 1}, "");
  visit.field("min_line_gradient", o.min_line_gradient, Range{0, 255}, "grey levels / px");
  visit.field("prior_neighbours", o.prior_neighbours, Range{1, 32}, "corners");
  visit.field("prior_radius", o.prior_radius, Range{0, 100000}, "px");
  visit.field("min_prior_sigma", o.min_prior_sigma, Range{0, 10}, "");
  visit.field("search_sigmas", o.search_sigmas, Range{0.1, 100}, "sigma");
  visit.field("max_search", o.max_search, Range{0.001, 1}, "image diagonals");
  visit.field("image_noise", o.image_noise, Range{0.01, 255}, "grey levels");
  visit.field("max_residual", o.max_residual, Range{0.1, 255}, "grey levels");
  visit.field("second_best_ratio", o.second_best_ratio, Range{1, 1000}, "");
  visit.field("line_error_floor", o.line_error_floor, Range{0, 100}, "px");
  visit.choice("fusion",
               o.fusion,
               {{"product", DepthFusion::kProduct}, {"most_precise", DepthFusion::kMostPrecise}});
  visit.field("fusion_gate", o.fusion_gate, Range{0.1, 1000}, "sigma");
  visit.field("max_outlier_votes", o.max_outlier_votes, Range{1, 1000}, "votes");
  visit.field("min_points", o.min_points, Range{1, 100000}, "points");
  visit.field("max_points", o.max_points, Range{0, 1000000}, "points");
}

}  // namespace dsorb
