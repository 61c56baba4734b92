// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/io/writers.h"

#include "app/command_line.h"
#include "app/interrupt.h"

namespace dsorb::app {

/// Result of a run for people and for the exit code.
struct RunResult {
  RunStatus outcome = RunStatus::kError;  ///< tracked, lost or never initialized
  bool interrupted = false;
  int frames_dropped = 0;                            ///< left out because the run was late
  InitReason last_answer = InitReason::kFirstFrame;  ///< of the initializer
  OdometryReport report;
};

/// Configuration for images of this photometry: it decides what is free in a frame's brightness,
/// unless a file or `--set` names `tracker.brightness`.
[[nodiscard]] Config configFor(ConfigSources sources, PhotometryMode photometry);

/// Reads the data set, runs the odometry on it and writes the output folder. After an error the
/// results so far are written before it is thrown on.
RunResult runDataset(const CommandLine& request, Interrupt& interrupt);

}  // namespace dsorb::app
