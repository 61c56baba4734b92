// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/error.h"
#include "dsorb/init/registry.h"
#include "dsorb/place/place.h"

#include "app/command_line.h"
#include "app/dataset_run.h"
#include "app/image_server.h"
#include "app/interrupt.h"
#include "app/standard_streams.h"
#include "platform/process.h"

#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include <exception>
#include <iostream>
#include <memory>
#include <new>
#include <string>

#ifdef __GLIBC__
#include <malloc.h>
#endif

namespace {

using namespace dsorb;

void setUpLog() {
  spdlog::set_default_logger(spdlog::stderr_logger_st("dso_dataset"));
  spdlog::set_pattern("%n: %l: %v");
}

/// Frames come and go, megabytes each: the allocator shall keep them instead of giving them back to
/// the kernel, which clears them anew for every frame.
void keepFreedMemory() {
#ifdef __GLIBC__
  // NOLINTBEGIN(concurrency-mt-unsafe) no thread is started yet
  mallopt(M_MMAP_THRESHOLD, 32 << 20);  // its maximum [bytes]
  mallopt(M_TRIM_THRESHOLD, 1 << 30);
  // NOLINTEND(concurrency-mt-unsafe)
#endif
}

void printSummary(const app::CommandLine& request, const app::RunResult& result) {
  const OdometryReport& report = result.report;
  std::string dropped = request.speed > 0 || result.frames_dropped > 0
                            ? fmt::format(", {} dropped", result.frames_dropped)
                            : "";
  if (result.frames_unreadable > 0) {
    dropped += fmt::format(", {} unreadable (named in run.json)", result.frames_unreadable);
  }
  const std::string reason =
      result.outcome == RunStatus::kTracked
          ? ""
          : fmt::format("the initializer's last answer: {}\n", name(result.last_answer));
  if (result.camera) fmt::print("{}\n", describe(*result.camera));
  if (result.calibration_suspected && !result.camera) {
    fmt::print("calibration suspected: calibration_suspected in run.json says by how much\n");
  }
  fmt::print("{}{}: {} of {} frames tracked{}, {} keyframes, {} segments\n{}{}\n",
             name(result.outcome),
             result.interrupted ? " (interrupted)" : "",
             report.frames_tracked,
             report.frames_given,
             dropped,
             report.keyframes,
             report.segments,
             reason,
             request.output);
}

int run(int argc, const char* const* argv, app::Interrupt& interrupt) {
  const app::CommandLine request = app::parseCommandLine(argc, argv);
  if (!request.text.empty()) {
    app::printText(request.text);
    return app::kTracked;
  }
  if (request.print_config) {
    const double sigma = request.sequence.horizontal_view > 0 ? kStatedFocalSigma : 0;
    app::printText(toYaml(app::configFor(request, request.sequence.brightness, sigma)));
    return app::kTracked;
  }
  for (const std::string& warning : request.warnings) {
    if (!request.quiet) spdlog::warn(warning);
  }
  if (!request.merge_maps.empty()) {
    const PlaceReport report = mergeMaps(request.merge_maps, request.save_map, PlaceOptions());
    if (!request.quiet) {
      fmt::print("{}: {} keyframes, {} segments joined, {} loops closed\n",
                 request.save_map,
                 report.keyframes,
                 report.joined,
                 report.loops);
    }
    return app::kTracked;
  }
  platform::ignoreWriteSignals();
  if (request.serve_images) {
    app::serveImages(request.sequence, std::cin, std::cout);
    return app::kTracked;
  }
  const app::RunResult result = app::runDataset(request, interrupt);
  if (!request.quiet) printSummary(request, result);
  return result.outcome == RunStatus::kTracked ? app::kTracked : app::kNotTracked;
}

}  // namespace

int main(int argc, char** argv) {
  keepFreedMemory();
  platform::openStandardStreams();
  app::Interrupt interrupt;  // before any thread is started
  setUpLog();
  try {
    return run(argc, argv, interrupt);
  } catch (const ConfigError& error) {
    spdlog::error("{}", error.what());
    return app::kWrongOptions;
  } catch (const std::bad_alloc&) {
    spdlog::error("out of memory");
    return app::kRuntimeError;
  } catch (const std::exception& error) {
    spdlog::error("{}", error.what());
    return app::kRuntimeError;
  }
}
