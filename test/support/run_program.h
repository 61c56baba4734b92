// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <csignal>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace dsorb {

/// How a program ended and what it printed.
struct ProgramResult {
  int exit_code = -1;  ///< -1: ended by a signal
  std::string out;
  std::string err;
};

/// Runs a program to its end.
/// @param arguments       program first
/// @param working_folder  where it runs and where its output is caught
/// @param interrupt_when  asked every few milliseconds; once true, SIGINT is sent
ProgramResult runProgram(const std::vector<std::string>& arguments,
                         const std::filesystem::path& working_folder,
                         const std::function<bool()>& interrupt_when = nullptr);

}  // namespace dsorb
