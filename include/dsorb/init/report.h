// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/cxx17.h"

#include <optional>
#include <string>
#include <utility>
#include <vector>

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

/// Wall time of a stage.
struct StageTime {
  std::string stage;        ///< name, for example "tracking"
  double milliseconds = 0;  ///< [ms]
};

/// A figure that a stage found, for logs and tests.
struct Detail {
  std::string name;  ///< as in `details` of initialization.json, with its unit where it has one
  double value = 0;  ///< truth values are 0 and 1
};

/// What led to a result.
struct InitReport {
  int restarts = 0;               ///< answers kRestarted since the object was made or reset
  std::string model;              ///< selected for the motion, for example "fundamental"
  std::vector<StageTime> stages;  ///< in the order in which they first ran
  std::vector<InitReason> earlier_resets;  ///< reasons of the latest restarts, oldest first
  double median_relative_sigma = 0;        ///< median of sigma over inverse depth [-]
  /// Probability that the direction of translation is off by more than
  /// GateOptions::wrong_angle_deg.
  std::optional<double> wrong_probability;
  std::optional<bool> depth_prior;  ///< FramePriors::depth of the reference: used, or not
  std::optional<bool> pose_prior;   ///< FramePriors::pose: taken, or contradicted by the images
  std::vector<Detail> details;      ///< what else the stages found, in their order

  /// Adds a detail.
  void add(std::string name, double value) { details.push_back({std::move(name), value}); }
  /// The latest detail of a name; nothing where no stage gave it.
  [[nodiscard]] std::optional<double> detail(const std::string& name) const;
};

}  // namespace dsorb
