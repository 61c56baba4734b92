// SPDX-License-Identifier: BSD-3-Clause
// A slow flight over a plane: every pair of images allows two motions.
#include "dsorb/init/initializer.h"

#include "support/init_run.h"

#include <gtest/gtest.h>

namespace dsorb {
namespace {

synthetic::SequenceOptions plane(unsigned seed) {
  synthetic::SequenceOptions options;
  options.kind = synthetic::SequenceKind::kPlane;
  options.seed = seed;
  options.width = 320;
  options.height = 240;
  return options;
}

TEST(PlaneStart, AllFramesTellWhichMotionIsRight) {
  std::size_t given = 0;
  for (const unsigned seed : {1U, 2U, 3U}) {
    synthetic::SequenceOptions options = plane(seed);
    options.speed = 0.3;
    options.length = 30;
    const RenderedSequence& sequence = rendered(options);
    const auto initializer = makeInitializer({}, sequence.camera());
    const InitRun run = feed(*initializer, sequence.frames());
    ASSERT_TRUE(run.result) << seed << " " << run.log();
    given += run.steps.size();
    EXPECT_LT(startErrors(*run.result, sequence).direction_deg, 2.2) << seed;  // .35 to 1.1
  }
  EXPECT_LE(given, 52U);  // measured 47
}

TEST(PlaneStart, ImagesMayBeFarApart) {
  for (const unsigned seed : {51U, 53U, 54U}) {
    synthetic::SequenceOptions options = plane(seed);
    options.rate = 1.5;
    options.length = 8;
    const RenderedSequence& sequence = rendered(options);
    const auto initializer = makeInitializer({}, sequence.camera());
    const InitRun run = feed(*initializer, sequence.frames());
    ASSERT_TRUE(run.result) << seed << " " << run.log();
    EXPECT_EQ(run.steps.size(), 3U) << seed;
    EXPECT_LT(startErrors(*run.result, sequence).direction_deg, 1.0) << seed;  // .59 at most
  }
}

}  // namespace
}  // namespace dsorb
