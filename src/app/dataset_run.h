// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/io/writers.h"
#include "dsorb/self_calibration/camera_finder.h"

#include "app/command_line.h"
#include "app/interrupt.h"

#include <optional>

namespace dsorb::app {

enum ExitCode { kTracked = 0, kRuntimeError = 1, kWrongOptions = 2, kNotTracked = 3 };

/// Result of a run for people and for the exit code.
struct RunResult {
  RunStatus outcome = RunStatus::kError;  ///< tracked, lost or never initialized
  bool interrupted = false;
  int frames_dropped = 0;                            ///< left out because the run was late
  int frames_unreadable = 0;                         ///< passed over
  InitReason last_answer = InitReason::kFirstFrame;  ///< of the initializer
  bool calibration_suspected = false;                ///< by the first keyframes
  std::optional<FoundCamera> camera;                 ///< where none was given, by earlier passes
  OdometryReport report;
};

/// Configuration for images of which this is known, unless a file or `--set` names its options.
/// @param known       empty: not known yet
/// @param focal_sigma of a camera that is a guess, and is refined
[[nodiscard]] Config configFor(const CommandLine& request,
                               std::optional<BrightnessModel> known,
                               double focal_sigma);

/// Reads the data set, runs the odometry on it and writes the output folder. After an error the
/// results so far are written before it is thrown on.
RunResult runDataset(const CommandLine& request, Interrupt& interrupt);

}  // namespace dsorb::app
