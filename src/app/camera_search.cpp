// SPDX-License-Identifier: BSD-3-Clause
#include "app/camera_search.h"

#include "dsorb/odometry/odometry.h"

#include "app/dataset_run.h"
#include "app/progress_bar.h"

#include <array>
#include <cmath>
#include <utility>

namespace dsorb::app {
namespace {

constexpr int kFirstLook = 120;  // images with a pose; the next after twice as many
/// Images with a pose by which corners tell a guess that the odometry does not bear for long.
constexpr int kEarlyLook = kFirstLook / 4;
constexpr double kBorne = 0.4;  // error of the focal length that it does bear, its logarithm
/// Standard deviation of the focal length by which a pass ends, relative, for each image with a
/// pose: what it is to tell is less exact the longer it takes.
constexpr double kEnough = 0.005 / 120;
/// Focal lengths of the passes, times the guess: the next one where a pass found nothing.
constexpr std::array<double, 3> kFocals = {1, 1.6, 0.6};

/// Begins again, with images that are rectified with a lens.
void rectifyWith(const Lens& lens, const CommandLine& request, SequenceReader& reader) {
  SequenceOptions sequence = request.sequence;
  sequence.keep_decoded = true;
  sequence.lens = lens;
  sequence.lens->readout = {};
  reader = SequenceReader(sequence, std::move(reader));
}

/// Whether a camera is known to be farther from the one that images are rectified with than an
/// odometry bears.
bool isFar(const Lens& found, const Lens& images) {
  const double difference =
      std::max(std::abs(std::log(found.fx / images.fx)), std::abs(std::log(found.fy / images.fy)));
  return difference > kBorne && 3 * found.focal_sigma < difference;
}

/// @param looks_early whether it ends as soon as images must be rectified with another camera
std::optional<FoundCamera> pass(SequenceReader& reader,
                                const Lens& guess,
                                const CommandLine& request,
                                const Interrupt& interrupt,
                                bool looks_early) {
  const Config config = configFor(request, reader.brightness(), reader.lens().focal_sigma);
  Odometry odometry(reader.camera(), config.options);
  CameraFinder finder(guess, reader.lens(), reader.camera(), config.options.num_threads);
  odometry.addObserver(&finder);
  ProgressBar progress(reader.selected(), request.progress, request.quiet);
  int next_look = kFirstLook;
  int given = 0;
  while (const auto input = reader.next()) {
    if (interrupt.requested()) return std::nullopt;
    const FrameEstimate estimate = odometry.process(input->frame);
    progress.update(estimate, 0);
    if (estimate.state == OdometryState::kLost) odometry.restart();
    ++given;
    if (looks_early && finder.frames() >= kEarlyLook) {
      looks_early = false;
      auto early = finder.find();
      if (early && isFar(early->lens, reader.lens())) return early;
    }
    // To see the rest costs less than a look that does not tell.
    const int left = reader.selected() - given;  // below 0: more than was announced
    const bool ends_soon = left >= 0 && 2 * left < given;
    if (finder.frames() < next_look || ends_soon) continue;
    auto found = finder.find();
    if (found && found->lens.focal_sigma < kEnough * next_look) return found;
    next_look *= 2;
  }
  return finder.find();
}

}  // namespace

bool isSearched(const SequenceReader& reader) {
  return reader.lens().focal_sigma > 0 && reader.format() != SequenceFormat::kCamera;
}

std::optional<FoundCamera> searchCamera(SequenceReader& reader,
                                        CommandLine request,
                                        const Interrupt& interrupt) {
  // Corners tell the camera. Starts and points need only carry the poses from which these are
  // adjusted, and a corner that contradicts them is left out.
  if (request.config.preset == "default") request.config.preset = "fast";
  for (const Mechanism left_out : {Mechanism::kClusters, Mechanism::kTail, Mechanism::kProof}) {
    request.skip.add(left_out);
  }
  Lens guess = reader.lens();
  if (!request.sequence.readout) guess.readout = kUnknownReadout;
  for (const double factor : kFocals) {
    if (factor != 1) {
      Lens lens = guess;
      lens.fx *= factor;
      lens.fy *= factor;
      rectifyWith(lens, request, reader);
    }
    auto found = pass(reader, guess, request, interrupt, true);
    if (found && isFar(found->lens, reader.lens())) {
      rectifyWith(found->lens, request, reader);
      const auto again = pass(reader, guess, request, interrupt, false);
      if (again && again->lens.focal_sigma < found->lens.focal_sigma) found = again;
    }
    if (found || interrupt.requested()) return found;
  }
  return std::nullopt;
}

}  // namespace dsorb::app
