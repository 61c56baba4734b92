// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/field.h"
#include "dsorb/options/orb_mapping.h"
#include "dsorb/options/orb_matching.h"
#include "dsorb/options/orb_motion.h"
#include "dsorb/options/orb_moving.h"
#include "dsorb/options/orb_photometric.h"

namespace dsorb {

/// Corners of the reference, followed from frame to frame.
struct FeatureTrackOptions {
  int max_corners = 1000;
  double corner_quality = 0.003;    ///< corner strength relative to the strongest of the image
  double min_distance = 8;          ///< between corners, for an image diagonal of 800 px
  int cell_size = 64;               ///< of the grid that spreads the corners
  int window = 21;                  ///< side of the patch that Lucas-Kanade aligns
  int max_level = 4;                ///< coarsest pyramid level of Lucas-Kanade
  int max_iterations = 30;          ///< of Lucas-Kanade on each level
  double min_step = 0.01;           ///< Lucas-Kanade stops at smaller steps
  double min_eigenvalue = 0.3;      ///< texture of a patch: smaller one of its mean gradient tensor
  double max_backward_error = 1;    ///< forward and backward again may miss the start by this much
  double min_survivor_share = 0.2;  ///< fewer survivors of one step: the scene was cut
};

template <typename Visitor, typename Options>
DescribeFor<Options, FeatureTrackOptions> describe(Visitor& visit, Options& o) {
  visit.field("max_corners", o.max_corners, Range{50, 20000}, "corners");
  visit.field("corner_quality", o.corner_quality, Range{1e-5, 1}, "");
  visit.field("min_distance", o.min_distance, Range{0, 100}, "px");
  visit.field("cell_size", o.cell_size, Range{8, 4096}, "px");
  visit.field("window", o.window, Range{5, 101}, "px");
  visit.field("max_level", o.max_level, Range{0, 8}, "levels");
  visit.field("max_iterations", o.max_iterations, Range{1, 1000}, "iterations");
  visit.field("min_step", o.min_step, Range{1e-4, 1}, "px");
  visit.field("min_eigenvalue", o.min_eigenvalue, Range{0, 1e4}, "grey levels^2 / px^2");
  visit.field("max_backward_error", o.max_backward_error, Range{0.01, 100}, "px");
  visit.field("min_survivor_share", o.min_survivor_share, Range{0, 1}, "");
}

/// Which of two models explains the matches.
enum class ModelChoice {
  kScore,   ///< by the homography's share of both scores
  kInliers  ///< the one with more inliers
};

/// Motion between the reference and the newest frame, the report's way.
struct TwoViewOptions {
  int rounds = 200;  ///< of RANSAC; both models use the same samples
  double sigma = 1;  ///< of a corner's position in each image
  ModelChoice model_choice = ModelChoice::kScore;
  double homography_share = 0.4;           ///< homography when S_H / (S_H + S_F) is above
  double min_rotation_residual_deg = 0.3;  ///< median that a rotation leaves; less: no parallax
  int min_triangulated = 50;               ///< good points of the best hypothesis
  double min_good_share = 0.9;             ///< good points of the best hypothesis, of the inliers
  double max_second_share = 0.7;           ///< good points of the second hypothesis, of the best's
  double min_parallax_deg = 1;             ///< of the point below
  int parallax_rank = 51;                  ///< this many points have the parallax above (or all)
};

template <typename Visitor, typename Options>
DescribeFor<Options, TwoViewOptions> describe(Visitor& visit, Options& o) {
  visit.field("rounds", o.rounds, Range{1, 100000}, "rounds");
  visit.field("sigma", o.sigma, Range{0.01, 100}, "px");
  visit.choice("model_choice",
               o.model_choice,
               {{"score", ModelChoice::kScore}, {"inliers", ModelChoice::kInliers}});
  visit.field("homography_share", o.homography_share, Range{0, 1}, "");
  visit.field("min_rotation_residual_deg", o.min_rotation_residual_deg, Range{0, 90}, "deg");
  visit.field("min_triangulated", o.min_triangulated, Range{8, 20000}, "points");
  visit.field("min_good_share", o.min_good_share, Range{0, 1}, "");
  visit.field("max_second_share", o.max_second_share, Range{0, 1}, "");
  visit.field("min_parallax_deg", o.min_parallax_deg, Range{0, 90}, "deg");
  visit.field("parallax_rank", o.parallax_rank, Range{1, 20000}, "points");
}

/// How points of the reference are found again.
enum class OrbFrontEnd {
  kTracks,      ///< corners followed from frame to frame by optical flow
  kDescriptors  ///< ORB features matched with the reference's by their descriptors
};

/// Options of ORBInitializer, one nested struct a stage.
struct OrbOptions {
  OrbFrontEnd front_end = OrbFrontEnd::kTracks;
  int min_frames = 2;          ///< before the first attempt, the reference counted
  int max_frames = 36;         ///< since a reference; then it is given up
  int min_tracked = 25;        ///< survivors of a reference's corners
  int reference_interval = 5;  ///< frames from one reference to the next; 0: only one at a time
  int max_attempts = 2;        ///< with one frame, oldest references first; 0: all of them
  FeatureTrackOptions tracks;
  OrbMatchingOptions matching;
  MotionMethod motion = MotionMethod::kInformed;
  InformedOptions informed;
  TwoViewOptions two_view;
  GeometricOptions geometric;
  SemiDenseOptions semi_dense;
  PhotometricOptions photometric;
  OutlierOptions outliers;
  MovingPartsOptions moving;
};

template <typename Visitor, typename Options>
DescribeFor<Options, OrbOptions> describe(Visitor& visit, Options& o) {
  visit.choice("front_end",
               o.front_end,
               {{"tracks", OrbFrontEnd::kTracks}, {"descriptors", OrbFrontEnd::kDescriptors}});
  visit.field("min_frames", o.min_frames, Range{2, 100}, "frames");
  visit.field("max_frames", o.max_frames, Range{2, 1000}, "frames");
  visit.field("min_tracked", o.min_tracked, Range{8, 20000}, "corners");
  visit.field("reference_interval", o.reference_interval, Range{0, 1000}, "frames");
  visit.field("max_attempts", o.max_attempts, Range{0, 1000}, "attempts");
  visit.group("tracks", o.tracks);
  visit.group("matching", o.matching);
  visit.choice("motion",
               o.motion,
               {{"report", MotionMethod::kReport}, {"informed", MotionMethod::kInformed}});
  visit.group("informed", o.informed);
  visit.group("two_view", o.two_view);
  visit.group("geometric", o.geometric);
  visit.group("semi_dense", o.semi_dense);
  visit.group("photometric", o.photometric);
  visit.group("outliers", o.outliers);
  visit.group("moving", o.moving);
}

}  // namespace dsorb
