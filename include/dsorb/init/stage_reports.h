// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/calibration.h"

#include <optional>

/// What the stages of the initializers report.
namespace dsorb {

/// Why an initializer answered as it did; for logs, observers and tests, never for control flow.
enum class InitReason {
  kFirstFrame,
  kTooFewPoints,
  kTooLittleParallax,
  kSettling,
  kTrackingLost,
  kDegenerateMotion,
  kPoorQuality,
  kTimeout,
  kDone,
  kHurried  ///< Initializer::setHurried
};

/// Name as in logs and JSON, for example "too_little_parallax".
[[nodiscard]] const char* name(InitReason reason);

/// Report of the direct initializer, "coarse".
struct DirectReport {
  double residual_rms = 0;   ///< [grey levels]
  double visible_share = 0;  ///< points in view and fit for tracking
  double motion_gain = 0;    ///< share of the energy of a pure rotation that translation removes
  double rival_margin = 0;   ///< energy of the best motion elsewhere over its own, less 1
};

/// Homography against fundamental matrix, and the adjustments of the corners' map.
struct TwoViewReport {
  int tracks = 0;                ///< matches of the two views
  double homography_score = 0;   ///< 0: no sample gave a model
  double fundamental_score = 0;  ///< 0: no sample gave a model
  int inliers = 0;               ///< matches that fit the chosen model
  int good_points = 0;           ///< good points of the best motion
  int second_good = 0;           ///< good points of the second-best motion
  double parallax_deg = 0;       ///< parallax of the point whose rank the options give
  int removed_severe = 0;        ///< corners far off or behind a camera, all adjustments together
  int removed_normal = 0;        ///< corners above the normal limit
};

/// Judgement of a start from the essential matrix: how likely it is that the newest frame's
/// direction of translation is off by more than GateOptions::wrong_angle_deg, and why.
struct GateReport {
  InitReason reason = InitReason::kDone;  ///< kDone when it passed
  double wrong_probability = 1;           ///< both causes together
  double error_probability = 1;           ///< first: tails of the direction's distribution
  double plane_probability = 0;           ///< second: the other motion that a plane allows
  double direction_sigma_deg = 0;         ///< larger axis of the direction's covariance, x 1.5
  double second_sigma_deg = 0;            ///< smaller axis, x 1.5: scale of its t-distribution
  double misfit = 1;        ///< errors of the corners over what noise of the images explains
  double depth_sigma = 0;   ///< predicted relative error of a corner's inverse depth, median
  double parallax_deg = 0;  ///< median angle under which both cameras see a corner
};

/// Corners measured again by aligning warped patches.
struct RefinementReport {
  bool accepted = false;  ///< the refined corners were taken
  bool fits = true;       ///< at least half of the corners match the images
  double first_rms = 0;   ///< error of the patches' pixels before the first step [grey levels]
  double last_rms = 0;    ///< error of the patches' pixels before the last step [grey levels]
  double direction_change_deg = 0;  ///< change of the direction of the newest translation [deg]
  int dropped = 0;                  ///< corners whose patches do not match
};

/// How much better the tracks of a start fit another lens than the calibrated one.
struct LensScore {
  double gain = 0;          ///< log likelihood that the best other lens gains [-]
  double focal_factor = 1;  ///< focal length of that lens over the calibrated one
  double radial = 0;        ///< its first coefficient of RadTan, beside the calibration

  /// Whether it contradicts the calibration by more than three standard deviations.
  [[nodiscard]] bool suspicious() const { return gain > 0.5 * 3 * 3; }
};

/// What became of depths that the caller knows of the reference.
struct DepthPriorReport {
  bool used = false;          ///< the start is made of them; otherwise it is one without
  bool contradicted = false;  ///< the images contradict them: they give no scale, either
  int corners = 0;            ///< corners that had a depth
  double inflation = 1;       ///< factor on the claimed standard deviations, to fit the images [-]
  double relative_sigma = 0;  ///< median relative sigma of a corner's known depth after that [-]
};

/// Essential matrix, model selection, gate and refinement.
struct EssentialReport {
  int tracks = 0;                          ///< matches of the two views
  int inliers = 0;                         ///< tracks that fit the chosen motion
  int stuck_tracks = 0;                    ///< left out: they move with the camera
  double rotation_residual = 0;            ///< median rotation-compensated flow [px]
  double front_share = 0;                  ///< corners in front of the camera
  std::optional<double> homography_gric;   ///< over that of the essential matrix, where compared
  std::optional<double> second_cost;       ///< cost of a plane's other motion over the best's
  GateReport gate;                         ///< whether the start was sure enough
  double track_noise = 0;                  ///< standard deviation of the corners, measured [px]
  RefinementReport refinement;             ///< refinement of the corners by patches
  double variance_factor = 0;              ///< a-posteriori [-]
  double clustered_factor = 0;             ///< on the clustered covariance [-]
  std::optional<Readout> readout_score{};  ///< readout by the tracks, where none is modelled
  std::optional<LensScore> lens_score{};   ///< where all rows are exposed at one time
};

/// Depths of gradient pixels beside the corners.
struct SemiDenseReport {
  int candidates = 0;  ///< selected gradient pixels
  int searched = 0;    ///< candidates whose gradient runs along an epipolar line
  int points = 0;      ///< candidates that were found consistently
  int searches = 0;    ///< epipolar searches made
  int matches = 0;     ///< searches that ended with an observation
};

/// Regions of the image that move by themselves.
struct DynamicRegionsReport {
  int contradicting_tracks = 0;  ///< tracks that do not fit the motion of the camera
  int removed = 0;               ///< corners and semi-dense points
};

/// Photometric adjustment.
struct PhotometricReport {
  bool usable = false;         ///< converged to numbers, lower cost, enough residuals inside
  int patches = 0;             ///< corners and semi-dense points that took part
  int frames = 0;              ///< frames in the adjustment, besides the reference
  int iterations = 0;          ///< steps of the solve at level 0 that gave the depths
  bool coarse_level = false;   ///< level 1 came first
  bool poses_moved = false;    ///< the photometric poses were taken, or have a part in the poses
  double first_cost = 0;       ///< half the weighted Huber energy of that problem
  double cost = 0;             ///< that energy afterwards
  double inside_share = 0;     ///< share of the patches' residuals inside the images [-]
  double median_residual = 0;  ///< before, absolute [grey levels]
  double pose_distance = 0;    ///< Mahalanobis, of the corners' poses and the photometric ones,
                               ///< a degree of freedom; 0: not compared
};

/// Removal of points by their residuals.
struct OutlierReport {
  int examined = 0;         ///< corners and semi-dense points
  int removed_corners = 0;  ///< corners taken out
  int removed_points = 0;   ///< semi-dense
  /// Scale of the residuals' t-distribution, median over the frames [grey levels]; combined: scale
  /// of the residuals over what their gradients let expect [-].
  double t_scale = 0;
};

}  // namespace dsorb
