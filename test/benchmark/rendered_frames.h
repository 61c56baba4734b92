// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "base/parallel.h"
#include "synthetic/sequence.h"

#include <benchmark/benchmark.h>

#include <utility>
#include <vector>

namespace dsorb {

/// Rendered images with the truth of the first one, kept so that frames can be made of them.
struct RenderedFrames {
  explicit RenderedFrames(const synthetic::SequenceOptions& options)
      : sequence(options), camera(sequence.camera()), inverse_depth(sequence.inverseDepth(0)) {
    for (int i = 0; i < sequence.length(); ++i) {
      images.push_back(sequence.frame(i));
      frames.push_back(sequence.framePtr(images.back(), i));
    }
  }
  /// Motion from the first frame's camera to that of another.
  [[nodiscard]] SE3 T_cam_first(int index) const {
    return sequence.pose(index).inverse() * sequence.pose(0);
  }

  synthetic::SyntheticSequence sequence;
  PinholeCamera camera;
  std::vector<synthetic::SyntheticFrame> images;
  std::vector<FramePtr> frames;
  std::vector<float> inverse_depth;  ///< of frame 0, row-major [1/m]
};

/// The sizes that matter: VGA indoors, KITTI outdoors.
inline synthetic::SequenceOptions roomOptions(int length) {
  synthetic::SequenceOptions options;
  options.kind = synthetic::SequenceKind::kRoom;
  options.length = length;
  options.noise_sigma = 2;  // [grey levels]; a camera indoors
  return options;
}

inline synthetic::SequenceOptions streetOptions(int length) {
  synthetic::SequenceOptions options = roomOptions(length);
  options.kind = synthetic::SequenceKind::kStreet;
  options.width = 1232;
  options.height = 368;
  return options;
}

/// Runs the timed loop with as many threads as the benchmark's first argument says.
template <typename Function>
void timeWithThreads(benchmark::State& state, Function&& function) {
  TaskArena arena(static_cast<int>(state.range(0)));
  for (auto _ : state) {  // NOLINT(readability-identifier-naming): the library's idiom
    arena.run([&] { benchmark::DoNotOptimize(function()); });
  }
}

}  // namespace dsorb
