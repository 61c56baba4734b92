// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/pyramid.h"

#include "features/corner_tracks.h"

namespace dsorb {

/// Leaves out the tracks on edges where most are on edges: bars, blinds, corrugated walls. Such a
/// track slides along its edge and knows one direction of its motion only; a few of them among
/// corners do no harm, but where they are most, they agree about motions that are wrong.
/// @param image that the tracks begin in
void leaveOutEdges(const PyramidLevel& image, CornerTracks& tracks);

}  // namespace dsorb
