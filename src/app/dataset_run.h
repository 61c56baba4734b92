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
  OdometryReport report;
};

/// Reads the data set, runs the odometry on it and writes the output folder. After an error what
/// was computed is written before it is thrown on.
RunResult runDataset(const CommandLine& request, const Config& config, Interrupt& interrupt);

}  // namespace dsorb::app
