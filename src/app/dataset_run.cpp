// SPDX-License-Identifier: BSD-3-Clause
#include "app/dataset_run.h"

#include "dsorb/odometry/odometry.h"

#include "app/progress_bar.h"
#include "io/recording_writer.h"

#include <opencv2/core/utility.hpp>

#include <algorithm>
#include <chrono>
#include <exception>
#include <optional>
#include <string>
#include <thread>
#include <utility>

namespace dsorb::app {
namespace {

int threadsInUse(int num_threads) {
  if (num_threads > 0) return num_threads;
  return std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
}

/// Values of the options tracker.brightness and window.brightness.
std::pair<std::string, std::string> brightnessOptions(PhotometryMode photometry) {
  switch (photometry) {
    case PhotometryMode::kCalibrated:
      return {"calibrated", "calibrated"};
    case PhotometryMode::kPerfect:
      return {"perfect", "fixed"};
    case PhotometryMode::kUncalibrated:
    case PhotometryMode::kAuto:
      break;
  }
  return {"uncalibrated", "free"};
}

RunInfo describeRun(const CommandLine& request, const Config& config) {
  RunInfo info;
  info.program = "dso_dataset";
  info.version = DSORB_VERSION;
  info.dataset = request.sequence.path;
  info.initializer = config.initializer;
  info.threads = threadsInUse(config.options.num_threads);
  info.config_yaml = toYaml(config);
  return info;
}

/// What writes during a run.
struct Writers {
  RunWriter* run = nullptr;
  io::RecordingWriter* recording = nullptr;  ///< null: no recording is wanted
};

/// Feeds every selected frame. @return whether the user ended it
bool feed(SequenceReader& reader,
          Odometry& odometry,
          const Writers& writers,
          const CommandLine& request,
          Interrupt& interrupt) {
  using Clock = std::chrono::steady_clock;
  ProgressBar progress(reader.selected(), request.progress, request.quiet);
  while (!interrupt.requested()) {
    const std::optional<SequenceFrame> input = reader.next();
    if (!input) return false;
    const Clock::time_point begin = Clock::now();
    const FrameEstimate estimate = odometry.process(input->frame);
    const std::chrono::duration<double, std::milli> processing = Clock::now() - begin;
    writers.run->frameDone(
        {processing.count() + input->pyramid_milliseconds, input->read_milliseconds});
    if (writers.recording != nullptr) writers.recording->frameDone(estimate);
    progress.update(estimate);
    if (estimate.state != OdometryState::kLost) continue;
    if (!request.restart_when_lost) return false;
    odometry.restart();
  }
  return true;
}

/// Writes what there is after an error; a second error must not hide the first.
void writeAfterError(RunWriter& writer, std::optional<Odometry>& odometry) {
  try {
    OdometryReport report;
    if (odometry) report = odometry->finish();
    writer.finish(RunStatus::kError, odometry ? &report : nullptr);
  } catch (const std::exception&) {
    return;
  }
}

}  // namespace

Config configFor(ConfigSources sources, PhotometryMode photometry) {
  if (photometry != PhotometryMode::kAuto) {
    const auto [tracker, window] = brightnessOptions(photometry);
    sources.program_defaults.push_back({"tracker.brightness", tracker, "photometry"});
    sources.program_defaults.push_back({"window.brightness", window, "photometry"});
  }
  return loadConfig(sources);
}

RunResult runDataset(const CommandLine& request, Interrupt& interrupt) {
  Config config = configFor(request.config, request.sequence.photometry);
  const RunInfo info = describeRun(request, config);
  cv::setNumThreads(info.threads);  // OpenCV's pool belongs to the process
  RunWriter writer(request.output, info);
  std::optional<io::RecordingWriter> recording;
  std::optional<Odometry> odometry;
  RunResult result;
  try {
    SequenceReader reader(request.sequence);
    writer.setCamera(reader.camera());
    config = configFor(request.config, reader.photometry());
    writer.setConfig(toYaml(config));
    odometry.emplace(reader.camera(), config.options);
    odometry->addObserver(&writer);
    if (!request.record.empty()) {
      recording.emplace(request.record, info, reader.camera());
      odometry->addObserver(&*recording);
    }
    const Writers writers{&writer, recording ? &*recording : nullptr};
    result.interrupted = feed(reader, *odometry, writers, request, interrupt);
    result.report = odometry->finish();
  } catch (...) {
    writeAfterError(writer, odometry);
    throw;
  }
  result.outcome = writer.outcome();
  const RunStatus status = result.interrupted ? RunStatus::kInterrupted : result.outcome;
  writer.finish(status, &result.report);
  if (recording) recording->finish(status);
  if (request.write_result_txt) writer.writeKeyframes("result.txt");
  return result;
}

}  // namespace dsorb::app
