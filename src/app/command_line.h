// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/io/config.h"
#include "dsorb/io/sequence_reader.h"

#include <string>
#include <vector>

namespace dsorb::app {

/// What is done about places that are seen again.
enum class PlacesMode { kOff, kJoin, kLoops };
enum class ProgressMode { kAuto, kOn, kOff };

/// The user's request.
struct CommandLine {
  SequenceOptions sequence;
  ConfigSources config;
  std::string output;  ///< folder
  std::string record;  ///< file of the recording; empty: none
  Skips skip;          ///< mechanisms that are left out, for measurements
  double speed = 0;    ///< of the playback over real time; 0 plays every frame as fast as possible
  bool restart_when_lost = true;
  PlacesMode places = PlacesMode::kLoops;
  std::string load_map;                 ///< file; empty: none
  std::string save_map;                 ///< file; empty: none
  std::vector<std::string> merge_maps;  ///< files that become save_map, instead of a run
  ProgressMode progress = ProgressMode::kAuto;
  bool quiet = false;
  bool print_config = false;
  bool serve_images = false;          ///< instead of a run
  bool write_result_txt = false;      ///< the original's words were used
  std::string text;                   ///< help or version: print it and stop
  std::vector<std::string> warnings;  ///< one line each
};

/// The model's name as a value of `--mode` and of the option `brightness`.
[[nodiscard]] std::string nameOf(BrightnessModel brightness);

/// Reads flags and the original program's `key=value` words.
/// @throws ConfigError with one line on what is wrong
[[nodiscard]] CommandLine parseCommandLine(int argc, const char* const* argv);

}  // namespace dsorb::app
