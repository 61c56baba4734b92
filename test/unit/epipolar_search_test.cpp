// SPDX-License-Identifier: BSD-3-Clause
#include "base/parallel.h"
#include "depth/candidate_activation.h"
#include "support/window_scene.h"
#include "synthetic/sequence.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace dsorb::depth {
namespace {

/// A rendered host with candidates of known depth.
struct SearchScene {
  synthetic::SyntheticSequence sequence;
  std::vector<CandidatePoint> candidates;
  std::vector<float> truth;  // inverse depths [1/m]

  static synthetic::SequenceOptions options() {
    synthetic::SequenceOptions o;
    o.kind = synthetic::SequenceKind::kRoom;
    o.width = 320;
    o.height = 240;
    o.rendering.supersampling = 2;
    return o;
  }
  SearchScene() : sequence(options()) {
    const synthetic::SyntheticFrame host = sequence.frame(0);
    const FramePtr frame = sequence.framePtr(host, 0);
    for (const auto& seed : window_scene::truePoints(frame->level(0), host.inverse_depth, 10, 0)) {
      const auto candidate = makeCandidate(frame->level(0), seed.pixel, 1);
      if (!candidate) continue;
      candidates.push_back(*candidate);
      truth.push_back(seed.inverse_depth);
    }
  }
  void search(std::vector<CandidatePoint>& points, int index) const {
    const SE3 T_frame_host = sequence.pose(index).inverse() * sequence.pose(0);
    const FramePtr frame = sequence.framePtr(index);
    searchEpipolarLines(
        points, EpipolarPair(sequence.camera(), T_frame_host, {}), frame->level(0), {});
  }
};

TEST(EpipolarSearchTest, FindsTheTrueDepthOfARenderedScene) {
  SearchScene scene;
  for (const int index : {2, 4, 6, 8, 10}) scene.search(scene.candidates, index);
  int known = 0, inside = 0, total = static_cast<int>(scene.candidates.size());
  std::vector<double> errors;
  for (std::size_t i = 0; i < scene.candidates.size(); ++i) {
    const CandidatePoint& candidate = scene.candidates[i];
    const bool usable = candidate.hasDepth() && candidate.quality > 3 &&
                        candidate.status != CandidateStatus::kOutlier;
    if (!usable) continue;
    ++known;
    inside += candidate.min_inverse_depth <= scene.truth[i] &&
                      scene.truth[i] <= candidate.max_inverse_depth
                  ? 1
                  : 0;
    errors.push_back(static_cast<double>(std::abs(candidate.middle() / scene.truth[i] - 1)));
  }
  ASSERT_GT(total, 300);
  std::nth_element(errors.begin(), errors.begin() + known / 2, errors.end());
  RecordProperty("known_share", std::to_string(static_cast<double>(known) / total));
  RecordProperty("inside_share", std::to_string(static_cast<double>(inside) / known));
  RecordProperty("median", std::to_string(errors[static_cast<std::size_t>(known / 2)]));
  EXPECT_GT(known, 0.6 * total);                                 // measured 0.71
  EXPECT_GT(inside, 0.9 * known);                                // measured 0.98
  EXPECT_LT(errors[static_cast<std::size_t>(known / 2)], 0.01);  // measured 0.0049
}

TEST(EpipolarSearchTest, ParallelSearchGivesTheSameBits) {
  SearchScene scene;
  std::vector<CandidatePoint> parallel = scene.candidates;
  scene.search(scene.candidates, 6);
  TaskArena(2).run([&] { scene.search(parallel, 6); });
  for (std::size_t i = 0; i < parallel.size(); ++i) {
    ASSERT_EQ(parallel[i].status, scene.candidates[i].status);
    ASSERT_EQ(parallel[i].min_inverse_depth, scene.candidates[i].min_inverse_depth);
  }
}

TEST(EpipolarSearchTest, BrightnessTransferIsApplied) {
  SearchScene scene;
  std::vector<CandidatePoint> plain = scene.candidates;
  scene.search(plain, 6);
  // The same frame, darker: I' = 0.7 I + 9.
  const synthetic::SyntheticFrame rendered = scene.sequence.frame(6);
  std::vector<float> dark;
  for (const std::uint8_t value : rendered.image) dark.push_back(0.7F * value + 9);
  const FramePtr frame = Frame::create(ImageView(dark.data(), 320, 240), {});
  const SE3 T_frame_host = scene.sequence.pose(6).inverse() * scene.sequence.pose(0);
  searchEpipolarLines(scene.candidates,
                      EpipolarPair(scene.sequence.camera(), T_frame_host, {0.7, 9}),
                      frame->level(0),
                      {});
  int good = 0, same = 0;
  for (std::size_t i = 0; i < plain.size(); ++i) {
    if (plain[i].status != CandidateStatus::kGood) continue;
    ++good;
    same += scene.candidates[i].status == CandidateStatus::kGood &&
                    std::abs(scene.candidates[i].middle() - plain[i].middle()) <
                        0.05F * plain[i].middle()
                ? 1
                : 0;
  }
  EXPECT_GT(good, 100);
  EXPECT_GT(same, 0.9 * good);
}

TEST(EpipolarSearchTest, LeavingTheImageIsFinalOnlyInReferenceMode) {
  SearchScene scene;
  const FramePtr frame = scene.sequence.framePtr(0);
  const SE3 turned(so3Exp({0, 1.2, 0}), {0.1, 0, 0});
  DepthOptions options;
  for (const bool published : {false, true}) {
    options.published = published;
    CandidatePoint candidate = scene.candidates[scene.candidates.size() / 2];
    searchEpipolarLine(
        candidate, EpipolarPair(scene.sequence.camera(), turned, {}), frame->level(0), options);
    EXPECT_EQ(candidate.status, CandidateStatus::kOutOfBounds);
    EXPECT_EQ(candidate.finished, published);
  }
}

TEST(EpipolarSearchTest, ShortIntervalsAreSkipped) {
  SearchScene scene;
  CandidatePoint candidate = scene.candidates[scene.candidates.size() / 2];
  const float truth = scene.truth[scene.candidates.size() / 2];
  candidate.min_inverse_depth = 0.999F * truth;
  candidate.max_inverse_depth = 1.001F * truth;
  const SE3 T_frame_host = scene.sequence.pose(6).inverse() * scene.sequence.pose(0);
  searchEpipolarLine(candidate,
                     EpipolarPair(scene.sequence.camera(), T_frame_host, {}),
                     scene.sequence.framePtr(6)->level(0),
                     {});
  EXPECT_EQ(candidate.status, CandidateStatus::kSkipped);
  EXPECT_EQ(candidate.min_inverse_depth, 0.999F * truth);
}

TEST(EpipolarSearchTest, WhatASearchWouldNotHalveIsLeftAlone) {
  SearchScene scene;
  const SE3 T_frame_host = scene.sequence.pose(6).inverse() * scene.sequence.pose(0);
  const EpipolarPair pair(scene.sequence.camera(), T_frame_host, {});
  const FramePtr frame = scene.sequence.framePtr(6);
  const PyramidLevel& level = frame->level(0);
  int good = 0;
  for (CandidatePoint candidate : scene.candidates) {
    searchEpipolarLine(candidate, pair, level, {});
    // An interval within the limits of the expected error is searched to its end.
    if (candidate.status != CandidateStatus::kGood || candidate.interval >= 20) continue;
    ++good;
    const float half = 0.5F * (candidate.max_inverse_depth - candidate.min_inverse_depth);
    const float middle = candidate.middle();
    const auto widened = [&](float factor) {
      candidate.min_inverse_depth = middle - factor * half;
      candidate.max_inverse_depth = middle + factor * half;
      searchEpipolarLine(candidate, pair, level, {});
      return candidate.status;
    };
    EXPECT_NE(widened(1.9F), CandidateStatus::kGood);  // 3.8 of the expected error
    EXPECT_NE(widened(2.1F), CandidateStatus::kIllConditioned);
  }
  EXPECT_GT(good, 20);
}

}  // namespace
}  // namespace dsorb::depth
