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

constexpr int kPasses = 3;
constexpr int kFirstLook = 60;     // images with a pose; the next after twice as many
constexpr double kEnough = 0.005;  // standard deviation of the focal length, relative
/// Focal lengths of passes after one that found nothing, times the guess.
constexpr std::array<double, 2> kOtherFocals = {1.6, 0.6};

bool isFarther(const FoundCamera& found, const Lens& used) {
  return std::abs(std::log(found.lens.fx / used.fx)) > used.focal_sigma;
}

/// One pass. It ends where the camera is known, and, unless it is the last one, where the camera
/// is another than the pass is run with. @return what it found at last
std::optional<FoundCamera> pass(SequenceReader& reader,
                                const Lens& guess,
                                bool is_last,
                                const CommandLine& request,
                                const Interrupt& interrupt) {
  const Config config = configFor(request, reader.brightness(), reader.lens().focal_sigma);
  Odometry odometry(reader.camera(), config.options);
  CameraFinder finder(guess, reader.lens(), reader.camera(), config.options.num_threads);
  odometry.addObserver(&finder);
  ProgressBar progress(reader.selected(), request.progress, request.quiet);
  int next_look = kFirstLook;
  while (const auto input = reader.next()) {
    if (interrupt.requested()) return std::nullopt;
    const FrameEstimate estimate = odometry.process(input->frame);
    progress.update(estimate, 0);
    if (estimate.state == OdometryState::kLost) odometry.restart();
    if (finder.frames() < next_look) continue;
    next_look *= 2;
    auto found = finder.find();
    if (!found) continue;
    const bool again = !is_last && isFarther(*found, reader.lens());
    if (again || found->lens.focal_sigma < kEnough) return found;
  }
  return finder.find();
}

}  // namespace

bool isSearched(const SequenceReader& reader) {
  return reader.lens().focal_sigma > 0 && reader.format() != SequenceFormat::kCamera;
}

SequenceOptions withLens(SequenceOptions sequence, const Lens& lens) {
  sequence.lens = lens;
  sequence.lens->readout.sigma = 0;
  return sequence;
}

std::optional<FoundCamera> searchCamera(SequenceReader first,
                                        const CommandLine& request,
                                        const Interrupt& interrupt) {
  Lens guess = first.lens();
  if (!request.sequence.readout) guess.readout = kUnknownReadout;
  Lens used = first.lens();
  std::optional<FoundCamera> found;
  for (int i = 0; i < kPasses && !interrupt.requested(); ++i) {
    if (i > 0) first = SequenceReader(withLens(request.sequence, used));
    auto better = pass(first, guess, i + 1 == kPasses, request, interrupt);
    if (!better && found) break;
    if (!better) {
      if (i == static_cast<int>(kOtherFocals.size())) break;
      used = guess;
      used.fx *= kOtherFocals.at(static_cast<std::size_t>(i));
      used.fy *= kOtherFocals.at(static_cast<std::size_t>(i));
      continue;
    }
    const bool stays = !isFarther(*better, used);
    used = better->lens;
    found = std::move(better);
    if (stays) break;
  }
  return found;
}

}  // namespace dsorb::app
