// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/self_calibration/camera_finder.h"

#include "app/command_line.h"
#include "app/interrupt.h"

#include <optional>

namespace dsorb::app {

/// Whether a lens is a guess that passes over these images can replace: a live camera has but one.
[[nodiscard]] bool isSearched(const SequenceReader& reader);

/// Passes over a recording, as much of it as it takes, until its camera is found; again with
/// another field of view where a pass found nothing.
/// @param reader opened, for the first pass; keeps what it decoded
/// @return nothing where the images do not tell, or after an interrupt
[[nodiscard]] std::optional<FoundCamera> searchCamera(SequenceReader& reader,
                                                      CommandLine request,
                                                      const Interrupt& interrupt);

}  // namespace dsorb::app
