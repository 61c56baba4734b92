// SPDX-License-Identifier: BSD-3-Clause
#include "app/dataset_run.h"

#include "dsorb/error.h"
#include "dsorb/odometry/odometry.h"

#include "app/playback.h"
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
#include <vector>

namespace dsorb::app {
namespace {

constexpr double kLongestSleep = 0.05;  // between two looks for Ctrl-C [s]

int threadsInUse(int num_threads) {
  if (num_threads > 0) return num_threads;
  return std::max(1, static_cast<int>(std::thread::hardware_concurrency()));
}

/// As a value of the option `brightness`.
std::string nameOf(BrightnessModel brightness) {
  switch (brightness) {
    case BrightnessModel::kCalibrated:
      return "calibrated";
    case BrightnessModel::kPerfect:
      return "perfect";
    case BrightnessModel::kUncalibrated:
      break;
  }
  return "uncalibrated";
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

/// Keeps the last answer of the initializer.
class InitializerListener : public OdometryObserver {
 public:
  void onInitStep(const InitStep& step, const Frame& /*frame*/, int /*segment*/) override {
    last_ = step.reason;
  }
  [[nodiscard]] InitReason last() const { return last_; }

 private:
  InitReason last_ = InitReason::kFirstFrame;
};

/// The writers of a run.
struct Writers {
  RunWriter* run = nullptr;
  io::RecordingWriter* recording = nullptr;  ///< null: no recording is wanted
};

Playback playbackOf(const SequenceReader& reader, double speed) {
  std::vector<double> timestamps;
  timestamps.reserve(static_cast<std::size_t>(reader.selected()));
  for (int i = 0; i < reader.selected(); ++i)
    timestamps.push_back(reader.timestamp(reader.index(i)));
  return Playback(std::move(timestamps), speed);
}

/// Feeds the selected frames at the wanted speed.
class Feeder {
 public:
  Feeder(SequenceReader& reader,
         Odometry& odometry,
         const Writers& writers,
         const CommandLine& request)
      : reader_(reader),
        odometry_(odometry),
        writers_(writers),
        request_(request),
        playback_(playbackOf(reader, request.speed)),
        progress_(reader.selected(), request.progress, request.quiet) {}

  /// @return whether the user ended it
  bool run(Interrupt& interrupt) {
    while (!interrupt.requested()) {
      const Playback::Step step = playback_.next(secondsSince(begin_));
      if (step.wait > 0) {
        std::this_thread::sleep_for(
            std::chrono::duration<double>(std::min(step.wait, kLongestSleep)));
        continue;
      }
      reader_.skip(step.drop);
      writers_.run->setDropped(playback_.dropped());
      const std::optional<SequenceFrame> input = reader_.next();
      if (!input) return false;
      if (!process(*input)) return false;
    }
    return true;
  }
  [[nodiscard]] int dropped() const { return playback_.dropped(); }

 private:
  using Clock = std::chrono::steady_clock;
  static double secondsSince(Clock::time_point begin) {
    return std::chrono::duration<double>(Clock::now() - begin).count();
  }

  /// @return whether there is more to do
  bool process(const SequenceFrame& input) {
    const Clock::time_point begin = Clock::now();
    const FrameEstimate estimate = odometry_.process(input.frame);
    const double milliseconds = secondsSince(begin) * 1e3;
    writers_.run->frameDone({milliseconds + input.pyramid_milliseconds, input.read_milliseconds});
    if (writers_.recording != nullptr) writers_.recording->frameDone(estimate);
    progress_.update(estimate, playback_.dropped());
    if (estimate.state != OdometryState::kLost) return true;
    if (request_.restart_when_lost) odometry_.restart();
    return request_.restart_when_lost;
  }

  SequenceReader& reader_;
  Odometry& odometry_;
  Writers writers_;
  const CommandLine& request_;
  Playback playback_;
  ProgressBar progress_;
  Clock::time_point begin_ = Clock::now();
};

/// Writes the results so far after an error. A second error must not hide the first.
void writeAfterError(const Writers& writers, std::optional<Odometry>& odometry) {
  try {
    OdometryReport report;
    if (odometry) report = odometry->finish();
    writers.run->finish(RunStatus::kError, odometry ? &report : nullptr);
    if (writers.recording != nullptr) writers.recording->finish(RunStatus::kError);
  } catch (const std::exception&) {
    return;
  }
}

/// Opens the data set. Wrong options leave the results of an earlier run alone; where the data
/// cannot be read the output folder says so.
SequenceReader openSequence(const CommandLine& request, const RunInfo& info) {
  try {
    return SequenceReader(request.sequence);
  } catch (const ConfigError&) {
    throw;
  } catch (const std::exception&) {
    RunWriter(request.output, info).finish(RunStatus::kError, nullptr);
    throw;
  }
}

}  // namespace

Config configFor(ConfigSources sources, std::optional<BrightnessModel> known) {
  if (known) sources.program_defaults.push_back({"brightness", nameOf(*known), "photometry"});
  return loadConfig(sources);
}

RunResult runDataset(const CommandLine& request, Interrupt& interrupt) {
  Config config = configFor(request.config, request.sequence.brightness);
  const RunInfo info = describeRun(request, config);
  cv::setNumThreads(info.threads);  // OpenCV's pool belongs to the process
  SequenceReader reader = openSequence(request, info);
  RunWriter writer(request.output, info);
  Writers writers{&writer};
  std::optional<io::RecordingWriter> recording;
  InitializerListener initializer;
  std::optional<Odometry> odometry;
  RunResult result;
  try {
    writer.setCamera(reader.camera());
    config = configFor(request.config, reader.brightness());
    writer.setConfig(toYaml(config));
    odometry.emplace(reader.camera(), config.options);
    odometry->addObserver(&writer);
    odometry->addObserver(&initializer);
    if (!request.record.empty()) {
      writers.recording = &recording.emplace(request.record, info, reader.camera());
      odometry->addObserver(&*recording);
    }
    Feeder feeder(reader, *odometry, writers, request);
    result.interrupted = feeder.run(interrupt);
    result.frames_dropped = feeder.dropped();
    result.report = odometry->finish();
    result.last_answer = initializer.last();
  } catch (...) {
    writeAfterError(writers, odometry);
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
