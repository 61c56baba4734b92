// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/field.h"
#include "dsorb/options/orb_mapping.h"

namespace dsorb {

/// Implementation of pyramidal Lucas-Kanade.
enum class OpticalFlow {
  kDsorb,  ///< in single precision, without rounding intensities and positions
  kOpenCv  ///< cv::calcOpticalFlowPyrLK, as [Gladkova]
};

/// Corners of the reference, followed from frame to frame.
struct FeatureTrackOptions {
  OpticalFlow flow = OpticalFlow::kDsorb;
  int max_corners = 1000;
  double corner_quality = 0.003;  ///< corner strength relative to the strongest of the image
  int max_level = 4;              ///< coarsest pyramid level of Lucas-Kanade
  double min_eigenvalue = 0.3;    ///< texture of a patch: smaller one of its mean gradient tensor
};

template <typename Visitor, typename Options>
DescribeFor<Options, FeatureTrackOptions> describe(Visitor& visit, Options& o) {
  visit.choice("flow", o.flow, {{"dsorb", OpticalFlow::kDsorb}, {"opencv", OpticalFlow::kOpenCv}});
  visit.field("max_corners", o.max_corners, Range{50, 20000}, "corners");
  visit.field("corner_quality", o.corner_quality, Range{1e-5, 1}, "");
  visit.field("max_level", o.max_level, Range{0, 8}, "levels");
  visit.field("min_eigenvalue", o.min_eigenvalue, Range{0, 1e4}, "grey levels^2 / px^2");
}

/// How ORBInitializer finds poses and corners.
enum class MotionMethod {
  kGladkova,  ///< homography against fundamental matrix, gates on the number of frames and points
  kEssential  ///< essential matrix and adjustment, gate on the predicted error of the direction
};

/// Conditions that a start must fulfil. Each limit lies in the range in which every measured
/// sequence keeps its bounds.
/// @source docs/experiments.md, "When to start"
struct GateOptions {
  int min_points = 60;           ///< corners left after the adjustment
  double min_track_share = 0.5;  ///< least share of the reference's live tracks that are left
  double min_front_share = 0.8;  ///< least share of the corners in front of the camera
  double max_direction_sigma_deg = 0.95;  ///< predicted sigma, scaled to 100 corners
  double max_fitted_sigma_deg = 0.25;     ///< sigma from the actual residuals, all corners
  double min_parallax_deg = 1.5;          ///< median angle under which both cameras see a corner
  double sharp_sigma_deg = 0.35;          ///< predicted sigma that needs less parallax
  double sharp_parallax_deg = 0.9;        ///< parallax that is enough for such a sharp start
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

/// Which of two models explains the matches.
enum class ModelChoice {
  kScore,   ///< by the homography's share of both scores
  kInliers  ///< the one with more inliers
};

/// How points of the reference are found again in later frames.
enum class OrbFrontEnd {
  kTracks,      ///< corners followed from frame to frame by optical flow
  kDescriptors  ///< ORB features matched with the reference's by their descriptors
};

/// Options of ORBInitializer, one nested struct a stage.
struct OrbOptions {
  OrbFrontEnd front_end = OrbFrontEnd::kTracks;
  int min_frames = 2;          ///< before the first attempt, including the reference
  int max_frames = 36;         ///< after which a reference is given up
  int min_tracked = 25;        ///< live tracks below which a reference is given up
  int reference_interval = 5;  ///< frames from one reference to the next; 0: only one at a time
  FeatureTrackOptions tracks;
  int max_features = 2000;  ///< ORB features that are matched by their descriptors
  MotionMethod motion = MotionMethod::kEssential;
  GateOptions gate;
  /// Rounds of refining the corners by patches of the reference, warped by pose and inverse depth,
  /// and adjusting again; 0 leaves it out. docs/experiments.md, "Refinement of corners"
  int polish_rounds = 5;
  ModelChoice model_choice = ModelChoice::kScore;
  GeometricOptions geometric;
  SemiDenseOptions semi_dense;
  PhotometricOptions photometric;
  OutlierRule outlier_rule = OutlierRule::kCombined;
  bool remove_moving = true;  ///< drops points where tracks contradict the camera's motion
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
  visit.group("tracks", o.tracks);
  visit.field("max_features", o.max_features, Range{50, 20000}, "features");
  visit.choice("motion",
               o.motion,
               {{"gladkova", MotionMethod::kGladkova}, {"essential", MotionMethod::kEssential}});
  visit.group("gate", o.gate);
  visit.field("polish_rounds", o.polish_rounds, Range{0, 100}, "rounds");
  visit.choice("model_choice",
               o.model_choice,
               {{"score", ModelChoice::kScore}, {"inliers", ModelChoice::kInliers}});
  visit.group("geometric", o.geometric);
  visit.group("semi_dense", o.semi_dense);
  visit.group("photometric", o.photometric);
  visit.choice("outlier_rule",
               o.outlier_rule,
               {{"none", OutlierRule::kNone},
                {"pixel_votes", OutlierRule::kPixelVotes},
                {"combined", OutlierRule::kCombined}});
  visit.field("remove_moving", o.remove_moving);
}

}  // namespace dsorb
