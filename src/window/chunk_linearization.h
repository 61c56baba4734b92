// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "window/normal_equations.h"
#include "window/photometric_residual.h"

#include <vector>

namespace dsorb::window {

/// Everything the evaluation of one chunk reads and writes.
struct ChunkContext {
  Window* window;
  const PairTable* pairs;
  const PointRef* refs;
  const LinearizeOptions* options;
  std::vector<Vector8d> frame_deviation;  // for frozen residuals
  PairSums* sums;                         // by target
  WindowEquations* out;
};

/// Evaluates the residuals of a chunk: trial values of its observations, rows of its points, sums
/// of its pairs. Chunks write to disjoint places.
void linearizeChunk(const ChunkContext& context, Chunk& chunk);

}  // namespace dsorb::window
