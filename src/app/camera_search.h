// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/self_calibration/camera_finder.h"

#include "app/command_line.h"
#include "app/interrupt.h"

#include <optional>

namespace dsorb::app {

/// Whether a lens is a guess that passes over these images can replace: a live camera has but one.
[[nodiscard]] bool isSearched(const SequenceReader& reader);

/// The sequence as images of a lens that was found, whose readout does not change while it is
/// tracked; its focal length goes on being refined.
[[nodiscard]] SequenceOptions withLens(SequenceOptions sequence, const Lens& lens);

/// Passes over a recording, as much of it as it takes, until its camera is found. A pass is
/// repeated with what it found where that is farther from what it was run with than the standard
/// deviation of that, or where it found nothing, with another field of view.
/// @param first opened, for the first pass
/// @return nothing where the images do not tell, or after an interrupt
[[nodiscard]] std::optional<FoundCamera> searchCamera(SequenceReader first,
                                                      const CommandLine& request,
                                                      const Interrupt& interrupt);

}  // namespace dsorb::app
