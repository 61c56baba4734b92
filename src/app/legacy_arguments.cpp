// SPDX-License-Identifier: BSD-3-Clause
#include "app/legacy_arguments.h"

#include "dsorb/error.h"

#include <fmt/ranges.h>
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <functional>
#include <map>
#include <type_traits>

namespace dsorb::app {
namespace {

template <typename Number>
Number number(const ConfigAssignment& word) {
  Number value{};
  const char* const end = word.value.data() + word.value.size();
  const auto [stop, error] = std::from_chars(word.value.data(), end, value);
  if (error != std::errc() || stop != end) {
    throw ConfigError(fmt::format("{}={}: expected a {}number",
                                  word.key,
                                  word.value,
                                  std::is_integral_v<Number> ? "whole " : ""));
  }
  return value;
}

int notNegative(const ConfigAssignment& word) {
  const int value = number<int>(word);
  if (value < 0) throw ConfigError(fmt::format("{}={}: must not be negative", word.key, value));
  return value;
}

/// Playback of the original above speed 0 maps in a thread of its own.
void playAt(double speed, const ConfigAssignment& word, CommandLine& request) {
  request.speed = speed;
  std::vector<ConfigAssignment>& flags = request.config.flags;
  const auto is_earlier_word = [](const ConfigAssignment& flag) {
    return flag.key == "pipelined" && flag.origin != "--pipelined";
  };
  flags.erase(std::remove_if(flags.begin(), flags.end(), is_earlier_word), flags.end());
  if (speed > 0) flags.push_back({"pipelined", "true", fmt::format("{}={}", word.key, word.value)});
}

/// Sets the speed anew, too: a `speed=` behind it wins, one before it does not.
/// @source presets of DSO as published
void setPreset(const ConfigAssignment& word, CommandLine& request) {
  struct Preset {
    const char* name;
    double speed;
  };
  constexpr std::array<Preset, 4> kPresets = {
      {{"default", 0}, {"default", 1}, {"fast", 0}, {"fast", 5}}};
  const int number_of_preset = number<int>(word);
  if (number_of_preset < 0 || number_of_preset >= static_cast<int>(kPresets.size())) {
    throw ConfigError(fmt::format("preset={}: must be 0, 1, 2 or 3", word.value));
  }
  const Preset& preset = kPresets[static_cast<std::size_t>(number_of_preset)];
  request.config.preset = preset.name;
  playAt(preset.speed, word, request);
}

void setMode(const ConfigAssignment& word, CommandLine& request) {
  switch (number<int>(word)) {
    case 0:
      request.sequence.brightness = BrightnessModel::kCalibrated;
      return;
    case 1:
      request.sequence.brightness = BrightnessModel::kUncalibrated;
      return;
    case 2:
      request.sequence.brightness = BrightnessModel::kPerfect;
      return;
    default:
      throw ConfigError(fmt::format("mode={}: must be 0, 1 or 2", word.value));
  }
}

void setSpeed(const ConfigAssignment& word, CommandLine& request) {
  const auto speed = number<double>(word);
  if (!(speed >= 0) || !std::isfinite(speed))
    throw ConfigError(fmt::format("speed={}: must be a number, not negative", word.value));
  playAt(speed, word, request);
}

using Handler = std::function<void(const ConfigAssignment&, CommandLine&)>;

/// Every word of the original; an empty handler: it has no meaning here.
const std::map<std::string, Handler>& handlers() {
  using Word = const ConfigAssignment&;
  static const std::map<std::string, Handler> kHandlers = {
      {"files", [](Word word, CommandLine& c) { c.sequence.path = word.value; }},
      {"calib", [](Word word, CommandLine& c) { c.sequence.calibration_file = word.value; }},
      {"gamma", [](Word word, CommandLine& c) { c.sequence.response_file = word.value; }},
      {"vignette", [](Word word, CommandLine& c) { c.sequence.vignette_file = word.value; }},
      {"preset", setPreset},
      {"mode", setMode},
      {"speed", setSpeed},
      {"start", [](Word word, CommandLine& c) { c.sequence.start = notNegative(word); }},
      {"end", [](Word word, CommandLine& c) { c.sequence.end = notNegative(word); }},
      {"reverse", [](Word word, CommandLine& c) { c.sequence.reverse |= number<int>(word) == 1; }},
      {"quiet", [](Word word, CommandLine& c) { c.quiet |= number<int>(word) == 1; }},
      {"nomt",
       [](Word word, CommandLine& c) {
         if (number<int>(word) == 1) c.config.flags.push_back({"num_threads", "1", "nomt=1"});
       }},
      {"nogui", {}},
      {"nolog", {}},
      {"prefetch", {}},
      {"save", {}},
      {"rescale", {}},
      {"rec", {}},
      {"noros", {}},
      {"sampleoutput", {}}};
  return kHandlers;
}

std::string keyOf(const std::string& word) {
  return word.substr(0, word.find('='));
}

}  // namespace

bool looksLikeLegacyArgument(const std::string& word) {
  const std::size_t equals = word.find('=');
  if (equals == std::string::npos) return false;
  if (handlers().count(keyOf(word)) > 0) return true;
  return word.find('/') > equals && !std::filesystem::exists(word);
}

void applyLegacyArguments(const std::vector<std::string>& words, CommandLine& command_line) {
  std::vector<std::string> meaningless;
  for (const std::string& text : words) {
    const ConfigAssignment word = parseAssignment(text, "word");
    const auto handler = handlers().find(word.key);
    if (handler == handlers().end()) {
      std::vector<std::string> known;
      for (const auto& entry : handlers()) known.push_back(entry.first);
      throw ConfigError(fmt::format(
          "unknown word '{}'; the closest known is '{}='", text, closestName(word.key, known)));
    }
    if (handler->second) {
      handler->second(word, command_line);
    } else if (std::find(meaningless.begin(), meaningless.end(), text) == meaningless.end()) {
      meaningless.push_back(text);
    }
  }
  command_line.write_result_txt = !words.empty();
  if (!meaningless.empty()) {
    command_line.warnings.push_back(
        fmt::format("without meaning here and ignored: {}", fmt::join(meaningless, " ")));
  }
}

}  // namespace dsorb::app
