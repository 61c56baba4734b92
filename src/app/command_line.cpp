// SPDX-License-Identifier: BSD-3-Clause
#include "app/command_line.h"

#include "dsorb/error.h"
#include "dsorb/io/calibration_reader.h"
#include "dsorb/place/place.h"
#include "dsorb/published/registration.h"

#include "io/input/gyroscope.h"
#include "io/input/image_source.h"

#include <CLI/CLI.hpp>
#include <fmt/ranges.h>
#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <functional>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <type_traits>
#include <vector>

namespace dsorb::app {
namespace {

/// Whole text as a number. @return empty where it is none
template <typename Number>
std::optional<Number> parsed(const std::string& text) {
  Number value{};
  const char* const end = text.data() + text.size();
  const auto [stop, error] = std::from_chars(text.data(), end, value);
  return error == std::errc() && stop == end ? std::optional(value) : std::nullopt;
}

template <typename Number>
Number number(const ConfigAssignment& word) {
  if (const auto value = parsed<Number>(word.value)) return *value;
  throw ConfigError(fmt::format("{}={}: expected a {}number",
                                word.key,
                                word.value,
                                std::is_integral_v<Number> ? "whole " : ""));
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
  constexpr std::array<BrightnessModel, 3> kNumbered = {
      BrightnessModel::kCalibrated, BrightnessModel::kUncalibrated, BrightnessModel::kPerfect};
  const int mode = number<int>(word);
  if (mode < 0 || mode > 2) throw ConfigError(fmt::format("mode={}: must be 0, 1 or 2", mode));
  request.sequence.brightness = kNumbered[static_cast<std::size_t>(mode)];
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

/// Whether a free word of the command line is meant as `key=value` and not as a path.
bool looksLikeLegacyArgument(const std::string& word) {
  const std::size_t equals = word.find('=');
  if (equals == std::string::npos) return false;
  if (handlers().count(keyOf(word)) > 0) return true;
  return word.find('/') > equals && !std::filesystem::exists(word);
}

/// Applies the `key=value` arguments of the original program, DSO's `dso_dataset`, a later one
/// overriding an earlier.
/// @throws ConfigError on an unknown word, a malformed value, or what this version lacks
/// @source "Usage" in the README of DSO
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

const std::map<std::string, SequenceFormat> kFormats = {{"auto", SequenceFormat::kAuto},
                                                        {"dso", SequenceFormat::kDso},
                                                        {"kitti", SequenceFormat::kKitti},
                                                        {"euroc", SequenceFormat::kEuroc},
                                                        {"tum", SequenceFormat::kTum},
                                                        {"images", SequenceFormat::kImages},
                                                        {"video", SequenceFormat::kVideo},
                                                        {"camera", SequenceFormat::kCamera}};
const std::map<std::string, BrightnessModel> kModes = {
    {"calibrated", BrightnessModel::kCalibrated},
    {"uncalibrated", BrightnessModel::kUncalibrated},
    {"perfect", BrightnessModel::kPerfect}};
const std::map<std::string, ProgressMode> kProgressModes = {
    {"auto", ProgressMode::kAuto}, {"on", ProgressMode::kOn}, {"off", ProgressMode::kOff}};

const std::map<std::string, PlacesMode> kPlacesModes = {
    {"off", PlacesMode::kOff}, {"join", PlacesMode::kJoin}, {"loops", PlacesMode::kLoops}};

constexpr double kMaxSpeed = 1e6;    // times real time
constexpr double kMaxSeconds = 1e9;  // from the first image

/// Says what is expected, which a failed conversion of CLI11 does not.
CLI::Validator wholeNumber(int low) {
  return {[low](const std::string& text) {
            if (parsed<int>(text).value_or(low - 1) >= low) return std::string();
            return fmt::format("'{}' must be a whole number{}",
                               text,
                               low == 0 ? ", not negative" : fmt::format(" from {}", low));
          },
          ""};
}

CLI::Validator numberIn(double low, double high) {
  return {[low, high](const std::string& text) {
            const double value = parsed<double>(text).value_or(low - 1);
            return value >= low && value <= high
                       ? std::string()
                       : fmt::format("'{}' must be a number in [{}, {}]", text, low, high);
          },
          ""};
}

std::string readoutComplaint(const std::string& text) {
  if (parseReadout(text)) return {};
  return fmt::format(
      "'{}' must be auto or a number in [{}, {}]", text, -kMaxReadoutMs, kMaxReadoutMs);
}

/// What CLI11 fills before it becomes a CommandLine.
struct Flags {
  std::vector<std::string> words;
  std::string format = "auto";
  std::string mode;
  std::string progress = "auto";
  std::string on_lost = "restart";
  std::string places;
  std::string initializer;
  std::string skip;
  std::vector<std::string> assignments;
  std::optional<int> threads;
  bool pipelined = false;
};

void addInputFlags(CLI::App& app, Flags& flags, CommandLine& request) {
  app.add_option(
         "DATASET",
         flags.words,
         "folder of a data set or of images, .zip of images, video file, /dev/videoN, rtsp://...")
      ->type_name("");
  app.option_defaults()->group("Input");
  app.add_option("--format",
                 flags.format,
                 "default auto: recognised by what lies in the folder; camera plays a "
                 "video file in its own time")
      ->check(CLI::IsMember(kFormats));
  app.add_option("--calib", request.sequence.calibration_file, "geometric calibration")
      ->type_name("FILE");
  app.add_option(
         "--camera",
         request.sequence.camera,
         "camera of a calibration with several, as it is called there: cam1, image_2, the "
         "topic of its images; default: the one that a folder of the images is called after")
      ->type_name("NAME");
  app.add_option("--gamma", request.sequence.response_file, "response of the camera (pcalib.txt)")
      ->type_name("FILE");
  app.add_option("--vignette", request.sequence.vignette_file, "vignette image")->type_name("FILE");
  app.add_option(
         "--hfov",
         request.sequence.horizontal_view,
         "what the images show from left to right, about, where there is no calibration; default: "
         "found out")
      ->type_name("DEGREES")
      ->check(numberIn(1, 157));
  app.add_option_function<std::string>(
         "--readout",
         [&request](const std::string& text) { request.sequence.readout = parseReadout(text); },
         "rolling shutter: time from the first to the last row, below 0 from the last to the "
         "first; 0: global; auto: estimated; default: as the calibration says")
      ->type_name("MS|auto")
      ->check(CLI::Validator(readoutComplaint, ""));
  app.add_option(
         "--mask",
         request.sequence.mask,
         "image whose black pixels are not used, beside those of masks/ beside the images; or "
         "another folder with one for each image")
      ->type_name("FILE");
  app.add_option("--mode",
                 flags.mode,
                 "photometry; default calibrated where response and vignette are there, else "
                 "uncalibrated")
      ->check(CLI::IsMember(kModes));
  app.add_option("--bits",
                 request.sequence.bits,
                 "that values of 16-bit images take, 9 to 16; default: 10 or 12 where all values "
                 "fit into them, else 16")
      ->type_name("N")
      ->check(CLI::Range(9, 16));
}

void addSelectionFlags(CLI::App& app, CommandLine& request) {
  app.add_option("--start", request.sequence.start, "first frame of the sequence; default 0")
      ->type_name("N")
      ->check(wholeNumber(0));
  app.add_option("--end", request.sequence.end, "one past the last frame; default: all")
      ->type_name("M")
      ->check(wholeNumber(0));
  app.add_flag("--reverse", request.sequence.reverse, "frames M-1 down to N, N included");
  app.add_flag("--skip-unreadable",
               request.sequence.skip_unreadable,
               "pass over image files that cannot be read; default: the first one ends the run");
  app.add_option("--every", request.sequence.every, "use each N-th frame; default 1")
      ->type_name("N")
      ->check(wholeNumber(1));
  app.add_option("--from", request.sequence.from, "skip what comes before; default 0")
      ->type_name("SECONDS")
      ->check(numberIn(0, kMaxSeconds));
  app.add_option("--to", request.sequence.to, "leave out what comes after; default: all")
      ->type_name("SECONDS")
      ->check(numberIn(0, kMaxSeconds));
  app.add_option("--width",
                 request.sequence.width,
                 "make images smaller, to this width; 0: keep them; default: as the calibration "
                 "says, and without one no side longer than 1280")
      ->type_name("PIXELS")
      ->check(wholeNumber(0));
  app.add_option("--use-depth",
                 request.sequence.depth_sigma,
                 "start from the depth images in depth/ (16 bits, millimetres, rectified), with "
                 "this relative standard deviation; default: not used")
      ->type_name("SIGMA")
      ->check(numberIn(1e-4, 1));
  app.add_option(
         "--gyro",
         request.sequence.gyroscope_file,
         "rates of a gyroscope: lines of time [s or ns], wx, wy, wz [rad/s] (imu0/data.csv)")
      ->type_name("FILE");
  app.add_option_function<std::string>(
         "--gyro-axes",
         [&request](const std::string& text) {
           const auto R = parseRotation(text);
           if (!R) {
             throw ConfigError(fmt::format(
                 "--gyro-axes: '{}': expected the nine numbers of a rotation, row by row", text));
           }
           request.sequence.R_cam_gyro = *R;
         },
         "rotation of the gyroscope's axes to those of the camera; default: the same")
      ->type_name("R11,...,R33");
}

std::string mechanismList() {
  std::string text;
  for (const MechanismName& entry : mechanisms()) {
    text += fmt::format("{:<16} {}\n", entry.name, entry.description);
  }
  return text;
}

void addMethodFlags(CLI::App& app, Flags& flags, CommandLine& request) {
  app.option_defaults()->group("Method");
  app.add_option("--initializer",
                 flags.initializer,
                 fmt::format("{}; default orb", fmt::join(initializerVariants(), ", ")))
      ->type_name("NAME");
  app.add_option("--preset",
                 request.config.preset,
                 fmt::format("{}; default default", fmt::join(presetNames(), ", ")))
      ->type_name("NAME");
  app.add_option("--config", request.config.files, "options from a YAML file; may repeat")
      ->type_name("FILE")
      ->expected(1)
      ->allow_extra_args(false)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  app.add_option("--set", flags.assignments, "one option, e.g. orb.min_frames=6; may repeat")
      ->type_name("KEY=VALUE")
      ->expected(1)
      ->allow_extra_args(false)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  app.add_flag("--print-config", request.print_config, "print all options as YAML and stop");
  app.add_option(
         "--skip", flags.skip, "for developers: leaves mechanisms out; list: prints them and stops")
      ->type_name("NAME,...");
  app.add_option("--threads", flags.threads, "default 0: all the machine has")
      ->type_name("N")
      ->check(wholeNumber(0));
  app.add_option("--on-lost", flags.on_lost, "stop or restart; default restart: a new segment")
      ->check(CLI::IsMember({"stop", "restart"}));
  app.add_option("--places",
                 flags.places,
                 "what is done where a place is seen again: off (default of cameras and with "
                 "--speed); join: segments that show one place become one; loops (default): also "
                 "closed where they are open by more than their uncertainty, which needs Ceres")
      ->check(CLI::IsMember(kPlacesModes));
  app.add_option(
         "--load-map",
         request.load_map,
         "map of an earlier run (--save-map): the run starts where the camera is recognized "
         "in it, in its world and unit")
      ->type_name("FILE");
  app.add_option("--speed",
                 request.speed,
                 "play back at X times real time and drop frames as a live camera would; 0 "
                 "(default): every frame, as fast as it goes")
      ->type_name("X")
      ->check(numberIn(0.0, kMaxSpeed));
  app.add_flag("--pipelined",
               flags.pipelined,
               "tracking and mapping in two threads, as live use needs; default: one after the "
               "other");
}

void addOutputFlags(CLI::App& app, Flags& flags, CommandLine& request) {
  app.option_defaults()->group("Output");
  app.add_option("--output", request.output, "folder; default out/<dataset name>")
      ->type_name("DIR");
  app.add_option("--record",
                 request.record,
                 "everything a viewer needs, one JSON object a line (docs/formats.md)")
      ->type_name("FILE");
  app.add_option("--save-map",
                 request.save_map,
                 "keyframes for --load-map and dsorb merge (docs/formats.md)")
      ->type_name("FILE");
  app.add_option("--merge-map",
                 request.merge_maps,
                 "no run: the maps named so become one, which --save-map names; at least two")
      ->type_name("FILE")
      ->expected(1)
      ->allow_extra_args(false)
      ->multi_option_policy(CLI::MultiOptionPolicy::TakeAll);
  app.add_flag("--serve-images",
               request.serve_images,
               "no run: for each position read from standard input the image there, as taken, is "
               "written to standard output as PPM");
  app.add_flag("--quiet", request.quiet, "print errors only");
  app.add_option("--progress", flags.progress, "default auto: a bar where a terminal is")
      ->check(CLI::IsMember(kProgressModes));
}

/// The first argument that looks like an option but is not one.
void refuseUnknownOptions(const CLI::App& app) {
  for (const std::string& word : app.remaining()) {
    std::vector<std::string> known;
    for (const CLI::Option* option : app.get_options()) {
      for (const std::string& name : option->get_lnames()) known.push_back("--" + name);
    }
    const std::string option = word.substr(0, word.find('='));
    throw ConfigError(
        fmt::format("unknown option '{}'; the closest is '{}'", word, closestName(option, known)));
  }
}

/// Data set and legacy arguments among the free words.
void takeWords(const std::vector<std::string>& words, CommandLine& request) {
  std::vector<std::string> legacy;
  std::vector<std::string> paths;
  for (const std::string& word : words) {
    (looksLikeLegacyArgument(word) ? legacy : paths).push_back(word);
  }
  if (paths.size() > 1) {
    throw ConfigError(
        fmt::format("one data set is expected, found '{}' and '{}'", paths[0], paths[1]));
  }
  applyLegacyArguments(legacy, request);
  if (paths.empty()) return;
  if (!request.sequence.path.empty()) {
    throw ConfigError(fmt::format(
        "one data set is expected, found '{}' and 'files={}'", paths[0], request.sequence.path));
  }
  request.sequence.path = paths[0];
}

void takeFlags(const Flags& flags, CommandLine& request) {
  request.sequence.format = kFormats.at(flags.format);
  if (!flags.mode.empty()) request.sequence.brightness = kModes.at(flags.mode);
  request.progress = kProgressModes.at(flags.progress);
  request.restart_when_lost = flags.on_lost == "restart";
  request.config.program_defaults = {{"num_threads", "0", "dso_dataset"}};
  if (flags.pipelined) request.config.flags.push_back({"pipelined", "true", "--pipelined"});
  for (const std::string& text : flags.assignments) {
    request.config.assignments.push_back(parseAssignment(text, "--set"));
  }
  if (!flags.initializer.empty()) {
    request.config.flags.push_back({"initializer.kind", flags.initializer, "--initializer"});
  }
  if (flags.threads) {
    request.config.flags.push_back({"num_threads", std::to_string(*flags.threads), "--threads"});
  }
}

/// What is done with places: live runs look for none unless a map is asked for.
void choosePlaces(const Flags& flags, CommandLine& request) {
  const std::string& path = request.sequence.path;
  const bool is_camera =
      request.sequence.format == SequenceFormat::kCamera || isCameraAddress(path);
  if (is_camera && request.speed > 0) {
    throw ConfigError("--speed plays recordings; a camera has a time of its own");
  }
  const bool is_live = is_camera || request.speed > 0;
  const bool uses_map = !request.load_map.empty() || !request.save_map.empty();
  request.places = !flags.places.empty()  ? kPlacesModes.at(flags.places)
                   : is_live && !uses_map ? PlacesMode::kOff
                                          : PlacesMode::kLoops;
  if (flags.places == "loops" && !canCloseLoops()) {
    throw ConfigError("--places loops needs a build with Ceres; join does without");
  }
  if (uses_map && request.places == PlacesMode::kOff) {
    throw ConfigError("--load-map and --save-map need --places join or loops");
  }
}

std::string datasetName(const std::string& path) {
  const std::filesystem::path absolute = std::filesystem::absolute(path).lexically_normal();
  const auto last = absolute.has_filename() ? absolute : absolute.parent_path();
  const bool is_file = !isCameraAddress(path) && !std::filesystem::is_directory(last);
  const std::string name = (is_file ? last.stem() : last.filename()).string();
  return name.empty() ? "dataset" : name;
}

}  // namespace

std::string nameOf(BrightnessModel brightness) {
  return std::find_if(kModes.begin(),
                      kModes.end(),
                      [&](const auto& mode) { return mode.second == brightness; })
      ->first;
}

CommandLine parseCommandLine(int argc, const char* const* argv) {
#ifdef DSORB_WITH_PUBLISHED
  published::registerInitializers();
#endif
  CommandLine request;
  Flags flags;
  CLI::App app("Monocular direct visual odometry on a data set, started from features.",
               "dso_dataset");
  app.allow_extras();
  app.get_formatter()->column_width(34);
  app.footer(
      "The original program's key=value words (files= calib= gamma= vignette= preset= mode= "
      "start=\n"
      "end= speed= reverse= quiet= nomt= ...) are understood too; with them the keyframe\n"
      "trajectory is also written to result.txt in the working directory.\n"
      "Exit codes: 0 tracked to the end, 1 runtime error, 2 wrong options, 3 never initialized or\n"
      "lost.");
  app.set_version_flag("--version", std::string("dso_dataset ") + DSORB_VERSION);
  addInputFlags(app, flags, request);
  addSelectionFlags(app, request);
  addMethodFlags(app, flags, request);
  addOutputFlags(app, flags, request);
  try {
    app.parse(argc, argv);
  } catch (const CLI::CallForHelp&) {
    request.text = app.help();
    return request;
  } catch (const CLI::CallForVersion&) {
    request.text = app.version() + "\n";
    return request;
  } catch (const CLI::ParseError& error) {
    throw ConfigError(error.what());
  }
  refuseUnknownOptions(app);
  if (flags.skip == "list") {
    request.text = mechanismList();
    return request;
  }
  request.skip = parseSkips(flags.skip);
  takeWords(flags.words, request);
  takeFlags(flags, request);
  if (!request.merge_maps.empty()) {
    if (request.merge_maps.size() < 2 || request.save_map.empty()) {
      throw ConfigError(
          "--merge-map: expected two maps or more, and --save-map for the merged one");
    }
    return request;
  }
  if (request.sequence.path.empty()) {
    if (request.print_config) return request;
    throw ConfigError("no data set given; --help shows the options");
  }
  choosePlaces(flags, request);
  if (request.output.empty()) request.output = "out/" + datasetName(request.sequence.path);
  return request;
}

}  // namespace dsorb::app
