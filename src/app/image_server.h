// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/io/sequence_reader.h"

#include <iosfwd>

namespace dsorb::app {

/// Answers every position among the words with the image there as the run would read it, upright
/// and before it is rectified: a PPM, or a PGM of grey ones, that notes in a comment how far it was
/// turned. Positions of a video ascend. The answers end where there is no such image.
/// @throws IoError on a data set or an image that cannot be read
void serveImages(const SequenceOptions& options, std::istream& positions, std::ostream& images);

}  // namespace dsorb::app
