// SPDX-License-Identifier: BSD-3-Clause
// Initializers of one process, each in a thread of its own, over the same frames: they share
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
    options.width = 192;
    options.height = 144;
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

TEST(SeveralInitializers, InThreadsOfTheirOwnEachGivesWhatItGivesAlone) {
  const Images images;
  const InitializationResult orb = startOf("orb", images);
  const InitializationResult coarse = startOf("coarse", images);
  ASSERT_FALSE(orb.frames.empty());
  ASSERT_FALSE(coarse.frames.empty());
  const std::vector<std::string> variants = {"orb", "orb", "coarse", "coarse"};
  std::vector<InitializationResult> beside(variants.size());
  std::vector<std::thread> threads;
  for (std::size_t i = 0; i < variants.size(); ++i) {
    threads.emplace_back([&, i] { beside[i] = startOf(variants[i], images); });
  }
  for (std::thread& thread : threads) thread.join();
  for (std::size_t i = 0; i < variants.size(); ++i) {
    SCOPED_TRACE(variants[i]);
    expectSameBits(beside[i], variants[i] == "orb" ? orb : coarse);
  }
}

}  // namespace
}  // namespace dsorb
