// SPDX-License-Identifier: BSD-3-Clause
#include "app/dataset_writer.h"
#include "platform/process.h"
#include "synthetic/sequence.h"

#include <CLI/CLI.hpp>
#include <fmt/format.h>

#include <cmath>
#include <cstdio>
#include <exception>
#include <map>
#include <string>

namespace {

using dsorb::synthetic::SequenceKind;
using dsorb::synthetic::SequenceOptions;
using dsorb::synthetic::SyntheticSequence;

constexpr int kRuntimeError = 1;
constexpr int kUsageError = 2;
constexpr double kDefaultNoise = 1.0;          // [grey levels], of a decent camera
constexpr double kDefaultExposureSwing = 0.3;  // of the log exposure
constexpr double kDefaultBlur = 0.3;           // share of the frame interval
constexpr double kRadiansPerDegree = 3.14159265358979323846 / 180.0;

struct CommandLine {
  SequenceOptions sequence;
  std::string kind;
  std::string output;
  double fov_deg = 0;
  double readout_ms = 0;
  int num_threads = 0;
  bool exposure_changes = false;
  bool motion_blur = false;
  bool quiet = false;
};

const std::map<std::string, SequenceKind> kKinds = {{"street", SequenceKind::kStreet},
                                                    {"room", SequenceKind::kRoom},
                                                    {"plane", SequenceKind::kPlane},
                                                    {"static", SequenceKind::kStatic},
                                                    {"rotation", SequenceKind::kRotation},
                                                    {"cut", SequenceKind::kCut},
                                                    {"block", SequenceKind::kBlock},
                                                    {"round", SequenceKind::kRound}};

void addOptions(CLI::App& app, CommandLine& line) {
  SequenceOptions& sequence = line.sequence;
  sequence.noise_sigma = kDefaultNoise;
  app.add_option("KIND", line.kind, "street, room, plane, static, rotation, cut, block or round")
      ->check(CLI::IsMember(kKinds))
      ->required();
  app.add_option("--output,-o", line.output, "folder, listed in its ../sequences.json")->required();
  app.add_option("--width", sequence.width, "image width [px]")
      ->check(CLI::Range(32, 8192))
      ->capture_default_str();
  app.add_option("--height", sequence.height, "image height [px]")
      ->check(CLI::Range(32, 8192))
      ->capture_default_str();
  app.add_option(
         "--fov", line.fov_deg, "horizontal field of view [deg]; default: 82 for street, else 77")
      ->check(CLI::Range(5.0, 150.0));
  app.add_option("--frames", sequence.length, "length of the sequence")
      ->check(CLI::Range(1, 100000))
      ->capture_default_str();
  app.add_option("--seed", sequence.seed, "texture, layout, path and noise")->capture_default_str();
  app.add_option("--noise", sequence.noise_sigma, "standard deviation [grey levels]")
      ->check(CLI::Range(0.0, 100.0))
      ->capture_default_str();
  app.add_flag("--exposure-changes",
               line.exposure_changes,
               "exposure time swings by 30 %, camera with a curved response (pcalib.txt)");
  app.add_option("--light", sequence.light, "in the place; above 1 the camera saturates")
      ->check(CLI::Range(0.0, 10.0))
      ->capture_default_str();
  app.add_flag("--vignette", sequence.vignette, "darker corners (vignette.png)");
  app.add_option("--readout",
                 line.readout_ms,
                 "rolling shutter: from the first to the last row [ms], negative: upwards")
      ->check(CLI::Range(-100.0, 100.0));
  app.add_option("--speed", sequence.speed, "of all motion, times the usual one")
      ->check(CLI::Range(0.01, 100.0))
      ->capture_default_str();
  app.add_option(
         "--rate", sequence.rate, "frames a second of the same motion; 0: 10 of street, else 30")
      ->check(CLI::Range(0.0, 1000.0))
      ->capture_default_str();
  app.add_flag("--blur", line.motion_blur, "motion blur, shutter open for 30 % of the time");
  app.add_flag("--moving-object", sequence.moving_object, "a car or crate that moves by itself");
  app.add_option("--moving-object-share",
                 sequence.moving_object_share,
                 "of the first street image that it covers: a van close ahead; 0: a car far ahead")
      ->check(CLI::Range(0.0, 0.5));
  app.add_flag("--moving-object-plain", sequence.moving_object_plain, "no texture on it");
  app.add_option("--camera-speed",
                 sequence.camera_speed,
                 "of the camera of a street alone, times --speed; 0: it stands in the traffic")
      ->check(CLI::Range(0.0, 100.0))
      ->capture_default_str();
  app.add_option("--supersampling", sequence.rendering.supersampling, "n x n rays a pixel")
      ->check(CLI::Range(1, 8))
      ->capture_default_str();
  app.add_option("--threads", line.num_threads, "0: all the machine has")
      ->check(CLI::Range(0, 1024))
      ->capture_default_str();
  app.add_flag("--quiet", line.quiet, "no progress line");
}

/// Sequence options of a parsed command line.
SequenceOptions sequenceOptions(const CommandLine& line) {
  SequenceOptions options = line.sequence;
  options.kind = kKinds.at(line.kind);
  if (line.fov_deg > 0) {
    options.fx = 0.5 * options.width / std::tan(0.5 * line.fov_deg * kRadiansPerDegree);
  }
  if (line.exposure_changes) {
    options.exposure_changes = kDefaultExposureSwing;
    options.nonlinear_response = true;
  }
  if (line.motion_blur) options.motion_blur = kDefaultBlur;
  options.readout = 1e-3 * line.readout_ms;
  return options;
}

void synthesize(const CommandLine& line) {
  const SyntheticSequence sequence(sequenceOptions(line));
  const bool is_terminal =
      dsorb::platform::errorIsTerminal();  // elsewhere one line at the end is enough
  const auto progress = [&](int done) {
    const bool is_last = done == sequence.length();
    if (line.quiet || !(is_terminal || is_last)) return;
    fmt::print(stderr,
               "{}{}: {} of {} frames{}",
               is_terminal ? "\r" : "",
               line.output,
               done,
               sequence.length(),
               is_last ? "\n" : "");
    std::fflush(stderr);
  };
  dsorb::app::writeDataset(sequence, line.output, line.num_threads, progress);
}

int run(int argc, char** argv) {
  CLI::App app("Renders a synthetic sequence with its truth as a data set in the layout of DSO");
  app.set_version_flag("--version", "dso_synthesize " DSORB_VERSION);
  CommandLine line;
  addOptions(app, line);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : kUsageError;
  }
  synthesize(line);
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return run(argc, argv);
  } catch (const std::exception& error) {
    fmt::print(stderr, "dso_synthesize: {}\n", error.what());
    return kRuntimeError;
  }
}
