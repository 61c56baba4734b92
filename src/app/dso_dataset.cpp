// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/error.h"
#include "dsorb/init/registry.h"
#include "dsorb/io/sequence_reader.h"
#include "dsorb/place/place.h"

#include "app/command_line.h"
#include "app/dataset_run.h"
#include "app/interrupt.h"
#include "io/input/dataset.h"
#include "platform/process.h"

#include <fmt/format.h>
#include <spdlog/sinks/stdout_sinks.h>
#include <spdlog/spdlog.h>

#include <algorithm>
#include <cerrno>
#include <cstdint>
#include <cstdio>
#include <exception>
#include <iostream>
#include <memory>
#include <new>
#include <string>
#include <system_error>

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

/// Prints a text that the user asked for.
/// @throws std::system_error where not all of it arrives
void printText(const std::string& text) {
  if (std::fputs(text.c_str(), stdout) < 0 || std::fflush(stdout) != 0) {
    throw std::system_error(errno, std::generic_category(), "standard output");
  }
}

/// A row as PNM wants it: red before blue, of two bytes the higher one first.
std::string rowOf(const cv::Mat& image, int row) {
  const std::size_t bytes = static_cast<std::size_t>(image.cols) * image.elemSize();
  std::string text(reinterpret_cast<const char*>(image.ptr(row)), bytes);
  if (image.channels() == 3) {
    for (std::size_t i = 0; i + 2 < bytes; i += 3) std::swap(text[i], text[i + 2]);
  }
  if (image.depth() == CV_16U) {
    for (std::size_t i = 0; i + 1 < bytes; i += 2) std::swap(text[i], text[i + 1]);
  }
  return text;
}

void write(const SourceImage& image, std::ostream& stream) {
  const cv::Mat& pixels = image.pixels;
  stream << fmt::format("P{}\n# turn {}\n{} {}\n{}\n",
                        pixels.channels() == 3 ? 6 : 5,
                        image.turn,
                        pixels.cols,
                        pixels.rows,
                        pixels.depth() == CV_16U ? 65535 : 255);
  for (int row = 0; row < pixels.rows; ++row) stream << rowOf(pixels, row);
  stream.flush();
}

/// Answers every position among the words with the image there as the run would read it, upright
/// and before it is rectified: a PPM, or a PGM of grey ones, that notes in a comment how far it was
/// turned. Positions of a video ascend. The answers end where there is no such image.
/// @throws IoError on a data set or an image that cannot be read
void serveImages(const SequenceOptions& options, std::istream& positions, std::ostream& images) {
  const Dataset dataset = openDataset(findDataset(options.path, options.format));
  const bool video = dataset.rate > 0;
  for (int position = 0; images && positions >> position;) {
    if (position < 0 || (!video && position >= dataset.images->size())) return;
    const auto image = dataset.images->image(position);
    if (!image) return;
    write(*image, images);
  }
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
    printText(request.text);
    return app::kTracked;
  }
  if (request.print_config) {
    const double sigma = request.sequence.horizontal_view > 0 ? kStatedFocalSigma : 0;
    printText(toYaml(app::configFor(request, request.sequence.brightness, sigma)));
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
    serveImages(request.sequence, std::cin, std::cout);
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
