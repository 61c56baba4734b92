// SPDX-License-Identifier: BSD-3-Clause
#include "app/dataset_run.h"

#include "dsorb/error.h"
#include "dsorb/odometry/odometry.h"
#include "dsorb/place/place.h"

#include "app/camera_search.h"
#include "app/playback.h"
#include "app/progress_bar.h"
#include "app/run_outputs.h"
#include "base/parallel.h"

#include <opencv2/core/utility.hpp>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <chrono>
#include <cstdio>
#include <exception>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <system_error>
#include <thread>
#include <utility>
#include <vector>

namespace dsorb::app {
namespace {

constexpr double kLongestSleep = 0.05;                     // between two looks for Ctrl-C [s]
constexpr std::chrono::milliseconds kWriterPatience(200);  // for a run that writes when it is ended

/// Where a file or folder is found from everywhere; a camera's address as it is.
std::string placeOf(const std::string& dataset) {
  std::error_code error;
  if (!std::filesystem::exists(dataset, error)) return dataset;
  const std::filesystem::path place = std::filesystem::absolute(dataset, error);
  return error ? dataset : place.lexically_normal().string();
}

RunInfo describeRun(const CommandLine& request, const Config& config) {
  RunInfo info;
  info.program = "dso_dataset";
  info.version = DSORB_VERSION;
  info.dataset = placeOf(request.sequence.path);
  info.initializer = config.initializer;
  info.threads = threadsInUse(config.options.num_threads);
  info.config_yaml = toYaml(config);
  return info;
}

Playback playbackOf(const SequenceReader& reader, double speed) {
  std::vector<double> timestamps;
  if (speed == 0 || reader.format() == SequenceFormat::kCamera) return Playback({}, 0);
  timestamps.reserve(static_cast<std::size_t>(reader.selected()));
  for (int i = 0; i < reader.selected(); ++i)
    timestamps.push_back(reader.timestamp(reader.index(i)));
  return Playback(std::move(timestamps), speed);
}

void warn(const CommandLine& request, const std::vector<std::string>& warnings) {
  for (const std::string& warning : warnings) {
    if (!request.quiet) spdlog::warn("{}", warning);
  }
}

/// What the camera does and the initializer does not model, one sentence each.
std::vector<std::string> notModelled(const Config& config, const Lens& lens) {
  const bool global_start = config.options.initializer.kind == InitializerKind::kCoarse ||
                            isPublishedVariant(config.initializer);
  if (!global_start || !lens.readout.isRolling()) return {};
  return {fmt::format("{} starts as if all rows were read at once; orb models a rolling shutter",
                      config.initializer)};
}

/// Feeds the selected frames at the wanted speed.
class Feeder {
 public:
  Feeder(SequenceReader& reader,
         Odometry& odometry,
         RunOutputs& outputs,
         const CommandLine& request)
      : reader_(reader),
        odometry_(odometry),
        outputs_(outputs),
        request_(request),
        playback_(playbackOf(reader, request.speed)),
        progress_(reader.selected(), request.progress, request.quiet) {}

  /// @return whether the user ended it
  bool run(const Interrupt& interrupt) {
    warn(request_, reader_.warnings());
    while (!interrupt.requested()) {
      const Playback::Step step = playback_.next(secondsSince(begin_));
      if (step.wait > 0) {
        std::this_thread::sleep_for(
            std::chrono::duration<double>(std::min(step.wait, kLongestSleep)));
        continue;
      }
      reader_.skip(step.drop);
      const std::optional<SequenceFrame> input = reader_.next();
      outputs_.setDropped(dropped());
      outputs_.setUnreadable(reader_.unreadable());
      if (!input) return false;
      if (!process(*input, step.late || input->late)) return false;
    }
    return true;
  }
  [[nodiscard]] int dropped() const { return playback_.dropped() + reader_.dropped(); }

 private:
  using Clock = std::chrono::steady_clock;
  static double secondsSince(Clock::time_point begin) {
    return std::chrono::duration<double>(Clock::now() - begin).count();
  }

  /// @return whether there is more to do
  bool process(const SequenceFrame& input, bool late) {
    warn(request_, input.warnings);
    const Clock::time_point begin = Clock::now();
    const FrameEstimate estimate = odometry_.process(input.frame, late);
    const double milliseconds = secondsSince(begin) * 1e3;
    const bool is_file =
        reader_.format() != SequenceFormat::kVideo && reader_.format() != SequenceFormat::kCamera;
    outputs_.frameDone({milliseconds + input.pyramid_milliseconds, input.read_milliseconds},
                       estimate,
                       is_file ? input.image_file : "");
    progress_.update(estimate, dropped());
    if (estimate.state != OdometryState::kLost) return true;
    if (request_.restart_when_lost) odometry_.restart();
    return request_.restart_when_lost;
  }

  SequenceReader& reader_;
  Odometry& odometry_;
  RunOutputs& outputs_;
  const CommandLine& request_;
  Playback playback_;
  ProgressBar progress_;
  Clock::time_point begin_ = Clock::now();
};

/// Writes the results so far after an error. A second error must not hide the first.
void writeAfterError(RunOutputs& outputs, std::optional<Odometry>& odometry) {
  std::optional<OdometryReport> report;
  try {
    if (odometry) report = odometry->finish();
  } catch (const std::exception&) {
    report.reset();
  }
  try {
    outputs.finish(RunStatus::kError, report ? &*report : nullptr);
  } catch (const std::exception&) {
    return;
  }
}

/// A name that is mistyped must not cost the results of an earlier run.
void requireFiles(const CommandLine& request) {
  const SequenceOptions& files = request.sequence;
  for (const std::string& name : {files.calibration_file,
                                  files.response_file,
                                  files.vignette_file,
                                  files.mask,
                                  request.load_map,
                                  files.gyroscope_file}) {
    if (name.empty() || std::filesystem::exists(name)) continue;
    throw IoError(fmt::format("{}: no such file", name));
  }
}

/// Opens the data set. Wrong options leave the results of an earlier run alone; where the data
/// cannot be read the output folder says so.
SequenceReader openSequence(const CommandLine& request, RunOutputs& outputs) {
  try {
    SequenceOptions sequence = request.sequence;
    sequence.keep_decoded = true;
    return SequenceReader(sequence);
  } catch (const ConfigError&) {
    throw;
  } catch (const std::exception&) {
    std::optional<Odometry> none;
    writeAfterError(outputs, none);
    throw;
  }
}

/// While it lives, an interrupt that the run does not answer in time writes the results so far.
class LateEnd {
 public:
  LateEnd(Interrupt& interrupt, RunOutputs& outputs, const CommandLine& request)
      : interrupt_(interrupt) {
    interrupt_.setLastResort([&outputs, &request] { return end(outputs, request); });
  }
  ~LateEnd() { interrupt_.setLastResort({}); }
  LateEnd(const LateEnd&) = delete;
  LateEnd& operator=(const LateEnd&) = delete;

 private:
  static int end(RunOutputs& outputs, const CommandLine& request) {
    try {
      const std::optional<RunStatus> outcome = outputs.finishNow(kWriterPatience);
      const RunStatus status = outcome.value_or(RunStatus::kInterrupted);
      if (!request.quiet) {
        fmt::print(
            "{} (interrupted before the frame was done)\n{}\n", name(status), request.output);
        std::fflush(stdout);
      }
      return status == RunStatus::kTracked ? kTracked : kNotTracked;
    } catch (const std::exception& error) {
      spdlog::error("{}", error.what());
      return kRuntimeError;
    }
  }
  Interrupt& interrupt_;
};

/// Recognition of places, where it is wanted; what it finds goes to the outputs.
std::unique_ptr<Place> placeFor(const CommandLine& request,
                                const Config& config,
                                RunOutputs& outputs) {
  if (request.places == PlacesMode::kOff) return nullptr;
  PlaceOptions options;
  options.loops = request.places == PlacesMode::kLoops;
  options.num_threads = config.options.num_threads;
  auto place = std::make_unique<Place>(options);
  place->addObserver(&outputs);
  return place;
}

}  // namespace

Config configFor(const CommandLine& request,
                 std::optional<BrightnessModel> known,
                 double focal_sigma) {
  ConfigSources sources = request.config;
  if (focal_sigma > 0) {
    const std::string source = "the camera is a guess";
    sources.program_defaults.push_back({"window.optimizer.optimize_intrinsics", "true", source});
    sources.program_defaults.push_back(
        {"window.prior.focal_sigma", fmt::format("{:.3g}", focal_sigma), source});
  }
  if (known) sources.program_defaults.push_back({"brightness", nameOf(*known), "photometry"});
  Config config = loadConfig(sources);
  OdometryOptions& options = config.options;
  options.initializer.skip = request.skip;
  if (request.skip.has(Mechanism::kJudge)) options.max_refusals = 0;
  if (request.skip.has(Mechanism::kMissed)) options.max_missed = 0;
  return config;
}

RunResult runDataset(const CommandLine& request, Interrupt& interrupt) {
  Config config = configFor(request, request.sequence.brightness, 0);
  requireFiles(request);
  const RunInfo info = describeRun(request, config);
  cv::setNumThreads(info.threads);  // OpenCV's pool belongs to the process
  RunOutputs outputs(request, info);
  const LateEnd late_end(interrupt, outputs, request);
  SequenceReader reader = openSequence(request, outputs);
  std::unique_ptr<Place> place;  // is told until the odometry ends
  std::optional<Odometry> odometry;
  RunResult result;
  try {
    if (isSearched(reader)) {
      result.camera = searchCamera(reader, request, interrupt);
      SequenceOptions sequence = request.sequence;
      if (result.camera) sequence.lens = result.camera->lens;
      reader = SequenceReader(sequence, std::move(reader));
      if (!result.camera) {
        warn(request, {"these images do not tell the camera: the run begins with a guess of it"});
        result.camera.emplace().lens = reader.lens();
      }
    }
    config = configFor(request, reader.brightness(), reader.lens().focal_sigma);
    warn(request, notModelled(config, reader.lens()));
    outputs.open(reader.camera(), reader.lens(), toYaml(config));
    if (result.camera) outputs.setFoundCamera(*result.camera);
    odometry.emplace(reader.camera(), config.options);
    odometry->addObserver(&outputs);
    place = placeFor(request, config, outputs);
    if (place) {
      odometry->addObserver(place.get());
      const int first = request.load_map.empty() ? 0 : place->load(request.load_map);
      odometry->setRecognizer(place->recognizer(reader.camera()), first);
    }
    Feeder feeder(reader, *odometry, outputs, request);
    result.interrupted = feeder.run(interrupt);
    result.frames_dropped = feeder.dropped();
    result.frames_unreadable = static_cast<int>(reader.unreadable().size());
    result.report = odometry->finish();
    if (place) result.report.segments -= place->finish().joined;
    if (!request.save_map.empty()) place->save(request.save_map);
  } catch (...) {
    interrupt.settle();
    writeAfterError(outputs, odometry);
    throw;
  }
  interrupt.settle();
  result.last_answer = outputs.lastAnswer();
  result.calibration_suspected = outputs.calibrationSuspected();
  result.outcome = outputs.outcome();
  outputs.finish(result.interrupted ? RunStatus::kInterrupted : result.outcome, &result.report);
  return result;
}

}  // namespace dsorb::app
