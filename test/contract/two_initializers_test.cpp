// SPDX-License-Identifier: BSD-3-Clause
// Two initializers of one process, each in a thread of its own, over the same frames: they share
// nothing that changes, so each gives what it gives alone. Also built under ThreadSanitizer.
#include "dsorb/init/initializer.h"

#include "synthetic/sequence.h"

#include <gtest/gtest.h>

#include <cstddef>
#include <string>
#include <thread>
#include <utility>
#include <vector>

namespace dsorb {
namespace {

constexpr int kFrames = 12;

struct Images {
  Images() {
    synthetic::SequenceOptions options;
    options.kind = synthetic::SequenceKind::kRoom;
    options.width = 320;
    options.height = 240;
    options.length = kFrames;
    options.noise_sigma = 1;
    const synthetic::SyntheticSequence sequence(options);
    camera = sequence.camera();
    for (int i = 0; i < kFrames; ++i) frames.push_back(sequence.framePtr(i));
  }
  PinholeCamera camera;
  std::vector<FramePtr> frames;
};

/// The first start of a variant; empty where it does not start.
InitializationResult startOf(const std::string& variant, const Images& images) {
  InitializerOptions options = initializerVariant(variant);
  options.num_threads = 2;
  const auto initializer = makeInitializer(options, images.camera);
  for (const FramePtr& frame : images.frames) {
    InitStep step = initializer->addFrame(frame);
    if (step.result) return std::move(*step.result);
  }
  return {};
}

void expectSameBits(const InitializationResult& a, const InitializationResult& b) {
  ASSERT_EQ(a.frames.size(), b.frames.size());
  for (std::size_t i = 0; i < a.frames.size(); ++i) {
    ASSERT_EQ(a.frames[i].T_cam_ref.has_value(), b.frames[i].T_cam_ref.has_value()) << i;
    if (!a.frames[i].T_cam_ref) continue;
    EXPECT_EQ(a.frames[i].T_cam_ref->matrix(), b.frames[i].T_cam_ref->matrix()) << i;
  }
  ASSERT_EQ(a.points.size(), b.points.size());
  for (std::size_t i = 0; i < a.points.size(); ++i) {
    EXPECT_EQ(a.points[i].inverse_depth, b.points[i].inverse_depth) << i;
    EXPECT_EQ(a.points[i].variance, b.points[i].variance) << i;
  }
}

TEST(TwoInitializers, InTwoThreadsEachGivesWhatItGivesAlone) {
  const Images images;
  const InitializationResult orb = startOf("orb", images);
  const InitializationResult coarse = startOf("coarse", images);
  ASSERT_FALSE(orb.frames.empty());
  ASSERT_FALSE(coarse.frames.empty());
  struct Run {
    std::string variant;
    const InitializationResult& alone;
  };
  const Run from_features{"orb", orb};
  const Run from_grey_values{"coarse", coarse};
  for (const auto& [one, other] : {std::pair(from_features, from_features),
                                   std::pair(from_features, from_grey_values),
                                   std::pair(from_grey_values, from_grey_values)}) {
    SCOPED_TRACE(one.variant + " beside " + other.variant);
    InitializationResult beside;
    std::thread thread(
        [&images, &beside, &other = other] { beside = startOf(other.variant, images); });
    const InitializationResult here = startOf(one.variant, images);
    thread.join();
    expectSameBits(here, one.alone);
    expectSameBits(beside, other.alone);
  }
}

}  // namespace
}  // namespace dsorb
