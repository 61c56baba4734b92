// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/field.h"

namespace dsorb {

/// Robust loss of reprojection errors.
enum class RobustLoss { kHuber, kCauchy };

/// Options of the geometric bundle adjustment of ORBInitializer.
struct GeometricOptions {
  double sigma = 0.5;  ///< standard deviation of a corner's position, unless measured [px]
  RobustLoss loss = RobustLoss::kCauchy;  ///< of reprojection errors
  double loss_threshold = 1.5;            ///< of the whitened error, where the loss bends [-]
};

/// Field list; see DescribeFor.
template <typename Visitor, typename Options>
DescribeFor<Options, GeometricOptions> describe(Visitor& visit, Options& o) {
  visit.field("sigma", o.sigma, Range{0.01, 100}, "px");
  visit.choice("loss", o.loss, {{"huber", RobustLoss::kHuber}, {"cauchy", RobustLoss::kCauchy}});
  visit.field("loss_threshold", o.loss_threshold, Range{0.1, 1000}, "");
}

/// How several observations of a depth are fused (docs/experiments.md, "Fusion of observations").
enum class DepthFusion {
  kProduct,     ///< product of Gaussians
  kMostPrecise  ///< the observation of smallest variance
};

/// Options of the semi-dense structure of ORBInitializer.
struct SemiDenseOptions {
  double image_noise = 2.8284;  ///< standard deviation of a grey value, sqrt(8) [grey levels]
  DepthFusion fusion = DepthFusion::kMostPrecise;  ///< of the observations of one point
  /// Number of corners and points that are adjusted and handed over, as many as the window takes:
  /// those of smallest relative variance. One and a half times as many candidates are searched,
  /// 3000 at least. 0 keeps all.
  int max_points = 2000;
};

/// Field list; see DescribeFor.
template <typename Visitor, typename Options>
DescribeFor<Options, SemiDenseOptions> describe(Visitor& visit, Options& o) {
  visit.field("image_noise", o.image_noise, Range{0.01, 100}, "grey levels");
  visit.choice("fusion",
               o.fusion,
               {{"product", DepthFusion::kProduct}, {"most_precise", DepthFusion::kMostPrecise}});
  visit.field("max_points", o.max_points, Range{0, 1000000}, "points");
}

/// How the brightness of a patch in two frames is made equal.
/// @source docs/experiments.md, "Brightness in the photometric adjustment"
enum class PhotometricBrightness {
  kPsiFixed,  ///< times the ratio psi of the patch sums, its derivative ignored, as [Gladkova]
  kAffine     ///< one pair (a, b) a frame as unknowns
};

/// Treatment of the corners' poses (docs/experiments.md, "Photometric adjustment").
enum class PhotometricPoses {
  kFree,     ///< adjusted with the inverse depths
  kFixed,    ///< kept; every inverse depth is refined on its own
  kCombined  ///< corners' and photometric ones weighted by their covariances
};

/// Options of the photometric bundle adjustment of ORBInitializer.
struct PhotometricOptions {
  bool enabled = true;  ///< false: the geometric result is handed over
  PhotometricBrightness brightness = PhotometricBrightness::kAffine;  ///< of patches
  PhotometricPoses poses = PhotometricPoses::kCombined;               ///< what becomes of them
  bool gradient_weights = true;  ///< pixels of strong gradients count less, as in [DSO]
  int max_frames = 4;            ///< evenly spaced, the newest included; 0: all
  int max_iterations = 4;        ///< of one solve
  int joint_points = 500;        ///< best points that give the poses, beside the corners; 0: all
};

/// Field list; see DescribeFor.
template <typename Visitor, typename Options>
DescribeFor<Options, PhotometricOptions> describe(Visitor& visit, Options& o) {
  visit.field("enabled", o.enabled);
  visit.choice("brightness",
               o.brightness,
               {{"psi_fixed", PhotometricBrightness::kPsiFixed},
                {"affine", PhotometricBrightness::kAffine}});
  visit.choice("poses",
               o.poses,
               {{"free", PhotometricPoses::kFree},
                {"fixed", PhotometricPoses::kFixed},
                {"combined", PhotometricPoses::kCombined}});
  visit.field("gradient_weights", o.gradient_weights);
  visit.field("max_frames", o.max_frames, Range{0, 16}, "frames");
  visit.field("max_iterations", o.max_iterations, Range{1, 1000}, "iterations");
  visit.field("joint_points", o.joint_points, Range{0, 100000}, "points");
}

/// Rule that removes points afterwards (docs/experiments.md, "Outlier filter").
enum class OutlierRule {
  kNone,
  kPixelVotes,  ///< [Gladkova]: pixels outside a quantile of the t-distribution
  kCombined     ///< predicted sigma, disagreement with neighbours, mean t-weight
};

}  // namespace dsorb
