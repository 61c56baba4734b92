// SPDX-License-Identifier: BSD-3-Clause
// A box that moves by itself must neither turn the estimated motion nor end up in the map.
#include "support/init_run.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

namespace dsorb {
namespace {

using synthetic::SequenceKind;
using synthetic::SequenceOptions;

constexpr double kShare = 0.1;  // of the image, the box

SequenceOptions street(std::uint64_t seed, bool with_box) {
  SequenceOptions options;
  options.kind = SequenceKind::kStreet;
  options.length = 16;
  options.seed = seed;
  options.noise_sigma = 1;
  options.moving_object = with_box;
  options.moving_object_share = with_box ? kShare : 0;
  return options;
}

InitRun start(const std::string& variant, const RenderedSequence& sequence) {
  return feed(*makeInitializer(initializerVariant(variant), sequence.camera()), sequence.frames());
}

/// Share of the points of a result that lie on what only one of two scenes shows.
double shareOnBox(const InitializationResult& result,
                  const RenderedSequence& with,
                  const RenderedSequence& without) {
  const int reference = result.frames.front().frame->id().value;
  const std::vector<float> a = with.inverseDepth(reference);
  const std::vector<float> b = without.inverseDepth(reference);
  int on_box = 0;
  for (const InitPoint& point : result.points) {
    const auto x = static_cast<std::size_t>(std::lround(point.pixel.x()));
    const auto y = static_cast<std::size_t>(std::lround(point.pixel.y()));
    const std::size_t pixel = y * static_cast<std::size_t>(with.camera().width) + x;
    on_box += a[pixel] != b[pixel] ? 1 : 0;
  }
  return on_box / static_cast<double>(result.points.size());
}

TEST(MovingObject, Measure) {
  for (const std::string name : {"coarse", "orb-v1", "orb", "orb-matching"}) {
    for (std::uint64_t seed : {1, 2, 3}) {
      const RenderedSequence& with = rendered(street(seed, true));
      const RenderedSequence& without = rendered(street(seed, false));
      const InitRun moving = start(name, with);
      const InitRun still = start(name, without);
      if (!moving.result || !still.result) {
        std::printf("%s %d none: %s | %s\n", name.c_str(), (int)seed, moving.log().c_str(), still.log().c_str());
        continue;
      }
      std::printf("%s seed %d dir %.2f (still %.2f) n %zu/%zu on box %.4f of %zu; depth %.3f (%.3f)\n",
                  name.c_str(), (int)seed,
                  startErrors(*moving.result, with).direction_deg,
                  startErrors(*still.result, without).direction_deg,
                  moving.result->frames.size(), still.result->frames.size(),
                  shareOnBox(*moving.result, with, without), moving.result->points.size(),
                  startErrors(*moving.result, with).median_relative_depth, startErrors(*still.result, without).median_relative_depth);
    }
  }
}

}  // namespace
}  // namespace dsorb
