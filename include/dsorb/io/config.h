// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/options/odometry.h"

#include <string>
#include <vector>

namespace dsorb {

/// One assignment to an option as text, with the place where it was written for messages.
struct ConfigAssignment {
  std::string key;     ///< full dotted key, or the end of exactly one: "orb.min_frames"
  std::string value;   ///< value as text
  std::string origin;  ///< where it was set, for example "--set", "slow.yaml:12"
};

/// Sources of options. A later one overrides an earlier one in this order: struct defaults, the
/// preset, `program_defaults`, the variant's OrbOptions, the files in their order, `assignments`,
/// `flags`. The key `initializer.kind` takes every variant name; the last one to name a variant
/// decides.
struct ConfigSources {
  std::string preset = "default";                  ///< name, see presetNames()
  std::vector<ConfigAssignment> program_defaults;  ///< what the user says goes before them
  std::vector<std::string> files;                  ///< YAML
  std::vector<ConfigAssignment> assignments;       ///< `--set`
  std::vector<ConfigAssignment> flags;             ///< named flags of the command line
};

/// Effective configuration of a run.
struct Config {
  std::string initializer = "orb";  ///< name of the variant
  OdometryOptions options;          ///< all of them
};

/// Reads all sources.
/// @throws ConfigError naming file, line, full key, what is allowed, and the closest valid key
[[nodiscard]] Config loadConfig(const ConfigSources& sources);

/// Every option as YAML with unit and range as comments; loading it gives the same configuration.
[[nodiscard]] std::string toYaml(const Config& config);

/// Presets compiled into the library: the files of configs/.
[[nodiscard]] std::vector<std::string> presetNames();

/// `key=value` as typed.
/// @throws ConfigError without `=` or without a key
[[nodiscard]] ConfigAssignment parseAssignment(const std::string& text, const std::string& origin);

/// The candidate with the smallest edit distance to the word, for messages that help with a typing
/// error. Empty when there are no candidates.
[[nodiscard]] std::string closestName(const std::string& word,
                                      const std::vector<std::string>& candidates);

}  // namespace dsorb
