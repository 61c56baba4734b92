// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/stage_reports.h"

#include <optional>
#include <string>
#include <vector>

namespace dsorb {

/// Wall time of a stage.
struct StageTime {
  std::string stage;        ///< name, for example "tracking"
  double milliseconds = 0;  ///< [ms]
};

/// What led to a result. The parts of stages that did not run are empty.
struct InitReport {
  int frames_fed = 0;             ///< since the reference, it included, that were kept
  int frames_posed = 0;           ///< frames with a pose, of those fed, the reference included
  int restarts = 0;               ///< answers kRestarted since the object was made or reset
  int points = 0;                 ///< handed over
  std::string model;              ///< selected for the motion, for example "fundamental"
  std::vector<StageTime> stages;  ///< in the order in which they first ran
  std::vector<InitReason> earlier_resets;  ///< reasons of the latest restarts, oldest first
  double median_parallax_deg = 0;          ///< rotation-compensated
  double inlier_ratio = 0;                 ///< inliers among the matches or points that were judged
  double residual_rms = 0;                 ///< [px]; `orb`: median, refined: of sigmas [-]
  double median_relative_sigma = 0;        ///< median of sigma over inverse depth [-]
  /// Probability that the direction of translation is off by more than
  /// GateOptions::wrong_angle_deg.
  std::optional<double> wrong_probability;
  std::optional<DirectReport> direct;           ///< `coarse`
  std::optional<TwoViewReport> two_view;        ///< published variants
  std::optional<EssentialReport> essential;     ///< `orb`
  std::optional<DepthPriorReport> depth_prior;  ///< FramePriors::depth of the reference
  std::optional<bool> pose_prior;               ///< FramePriors::pose: taken (true) or contradicted
  std::optional<SemiDenseReport> semi_dense;    ///< the published variants
  std::optional<DynamicRegionsReport> dynamic_regions;  ///< OrbOptions::remove_moving
  std::optional<PhotometricReport> photometric;         ///< the published variants
  std::optional<OutlierReport> outliers;                ///< the published variants
  std::optional<PhotometricReport> second_photometric;  ///< after the outliers are gone
  std::optional<int> corners;                           ///< number of corners in the result
  std::optional<bool> optical_flow;  ///< matches by optical flow, not by descriptors
};

}  // namespace dsorb
