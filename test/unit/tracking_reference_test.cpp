// SPDX-License-Identifier: BSD-3-Clause
#include "track/tracking_reference.h"

#include "support/textured_plane.h"
#include "support/tracking_reference_of.h"

#include <gtest/gtest.h>

#include <limits>

namespace dsorb::track {
namespace {

DepthAccumulator emptyMap(int width, int height) {
  DepthAccumulator map;
  map.reset(width, height);
  return map;
}

void put(DepthAccumulator& map, int x, int y, float depth, float weight) {
  map.weighted_depth[map.index(x, y)] += depth * weight;
  map.weight[map.index(x, y)] += weight;
}

TEST(TrackingReference, BlocksAddWeightsAndWeightedDepths) {
  DepthAccumulator fine = emptyMap(4, 4);
  put(fine, 2, 0, 0.5F, 3.0F);
  put(fine, 3, 1, 1.0F, 1.0F);
  DepthAccumulator coarse;
  accumulateBlocks(fine, coarse);
  ASSERT_EQ(coarse.width, 2);
  ASSERT_EQ(coarse.height, 2);
  EXPECT_FLOAT_EQ(coarse.weight[coarse.index(1, 0)], 4.0F);
  EXPECT_FLOAT_EQ(coarse.weighted_depth[coarse.index(1, 0)], 2.5F);
  EXPECT_FLOAT_EQ(coarse.weight[coarse.index(0, 0)], 0.0F);
}

TEST(TrackingReference, DilationTakesTheMeanOfNeighboursWithWeightAndDoesNotCascade) {
  DepthAccumulator map = emptyMap(7, 5);
  put(map, 2, 2, 0.5F, 2.0F);
  put(map, 4, 2, 1.0F, 6.0F);
  dilate(map, DilationNeighbours::kDiagonal);
  // (3, 1) and (3, 3) touch both samples diagonally: sums (1 + 6) / 2 and (2 + 6) / 2.
  for (const int y : {1, 3}) {
    const std::size_t i = map.index(3, y);
    EXPECT_FLOAT_EQ(map.weighted_depth[i] / map.weight[i], 3.5F / 4.0F);
    EXPECT_FLOAT_EQ(map.weight[i], -4.0F) << "given by dilation, hence negative";
  }
  EXPECT_FLOAT_EQ(map.weight[map.index(1, 1)], -2.0F);
  EXPECT_FLOAT_EQ(map.weight[map.index(3, 2)], 0.0F) << "direct neighbour of samples only";
  EXPECT_FLOAT_EQ(map.weight[map.index(2, 2)], 2.0F) << "a sample stays as it is";
  EXPECT_FLOAT_EQ(map.weight[map.index(6, 0)], 0.0F) << "outermost pixels are left alone";
}

TEST(TrackingReference, DirectDilationUsesTheFourNearestNeighbours) {
  DepthAccumulator map = emptyMap(5, 5);
  put(map, 2, 2, 0.5F, 2.0F);
  dilate(map, DilationNeighbours::kDirect);
  EXPECT_FLOAT_EQ(map.weight[map.index(2, 1)], -2.0F);
  EXPECT_FLOAT_EQ(map.weight[map.index(1, 2)], -2.0F);
  EXPECT_FLOAT_EQ(map.weight[map.index(1, 1)], 0.0F);
}

/// Pixel positions of a level's points.
std::vector<Eigen::Vector2d> pixels(const TrackingReference& reference,
                                    const PinholeCamera& camera,
                                    int level) {
  std::vector<Eigen::Vector2d> result;
  const ReferencePoints& points = reference.at(level);
  for (std::size_t i = 0; i < points.size(); ++i) {
    result.push_back(camera.atLevel(level).project({points.ray_x[i], points.ray_y[i], 1.0}));
  }
  return result;
}

TEST(TrackingReference, FinestLevelKeepsExactPositionsAndWidensThemDiagonally) {
  const PinholeCamera camera = smallCamera();
  const TexturedPlane scene;
  const FramePtr frame = scene.render(camera, SE3(), {FrameId{0}});
  const TrackingReference reference = referenceOf(frame, camera, {{{50.3F, 40.6F}, 0.5F, 2.0F}});
  const std::vector<Eigen::Vector2d> found = pixels(reference, camera, 0);
  // The sample belongs to pixel (50, 41); dilation reaches the four pixels diagonal to that.
  const std::vector<Eigen::Vector2d> expected = {
      {50.3, 40.6}, {49, 40}, {51, 40}, {49, 42}, {51, 42}};
  ASSERT_EQ(found.size(), expected.size());
  for (std::size_t i = 0; i < found.size(); ++i) {
    EXPECT_LT((found[i] - expected[i]).norm(), 1e-4) << found[i].transpose();
    const double truth = scene.intensity(SE3(), camera.unproject(expected[i]));
    // Bilinear interpolation on this texture: measured 0.03 grey levels, margin x2.
    EXPECT_NEAR(reference.at(0).intensity[i], truth, 0.06);
    EXPECT_FLOAT_EQ(reference.at(0).inverse_depth[i], 0.5F);
  }
}

TEST(TrackingReference, CoarserLevelsAverageByWeight) {
  const PinholeCamera camera = smallCamera();
  const FramePtr frame = TexturedPlane().render(camera, SE3(), {FrameId{0}});
  // Both samples lie in pixel (12, 10) of level 2, which gets (3 * 0.5 + 1 * 1) / 4.
  const TrackingReference reference =
      referenceOf(frame, camera, {{{48, 41}, 0.5F, 3.0F}, {{51, 43}, 1.0F, 1.0F}});
  const std::vector<Eigen::Vector2d> found = pixels(reference, camera, 2);
  const std::vector<Eigen::Vector2d> expected = {{12, 9}, {11, 10}, {12, 10}, {13, 10}, {12, 11}};
  ASSERT_EQ(found.size(), expected.size());
  for (std::size_t i = 0; i < found.size(); ++i) {
    EXPECT_LT((found[i] - expected[i]).norm(), 1e-4) << found[i].transpose();
    EXPECT_FLOAT_EQ(reference.at(2).inverse_depth[i], 0.625F);
  }
}

TEST(TrackingReference, LeavesOutWhatCannotBeTracked) {
  const PinholeCamera camera = smallCamera();
  std::vector<float> image(static_cast<std::size_t>(camera.width * camera.height), 50.0F);
  image[static_cast<std::size_t>(60 * camera.width + 80)] = std::numeric_limits<float>::quiet_NaN();
  const FramePtr frame =
      Frame::create(ImageView(image.data(), camera.width, camera.height), {FrameId{0}});
  TrackingReferenceBuilder builder(camera);
  TrackingReference reference{frame, camera, {}};
  const float nan = std::numeric_limits<float>::quiet_NaN();
  builder.fill({{{1, 50}, 0.5F, 1.0F},
                {{50, 126}, 0.5F, 1.0F},
                {{nan, 50}, 0.5F, 1.0F},
                {{60, 50}, -0.5F, 1.0F},
                {{60, 50}, nan, 1.0F},
                {{60, 50}, 0.5F, 0.0F}},
               reference);
  for (int l = 0; l < reference.levels(); ++l) EXPECT_EQ(reference.at(l).size(), 0U) << l;
  builder.fill({{{80, 60}, 0.5F, 1.0F}}, reference);
  EXPECT_EQ(reference.at(0).size(), 4U) << "the invalid pixel itself must be missing";
}

TEST(TrackingReference, DoesNotDependOnTheOrderOfSamples) {
  const PinholeCamera camera = smallCamera();
  const TexturedPlane scene;
  const FramePtr frame = scene.render(camera, SE3(), {FrameId{0}});
  std::vector<DepthSample> samples = scene.samples(camera, SE3(), 5, 0.25F);
  const TrackingReference forward = referenceOf(frame, camera, samples);
  std::reverse(samples.begin(), samples.end());
  const TrackingReference backward = referenceOf(frame, camera, samples);
  EXPECT_EQ(forward.at(0).ray_x, backward.at(0).ray_x);
  EXPECT_EQ(forward.at(0).inverse_depth, backward.at(0).inverse_depth);
}

TEST(TrackingReference, NothingIsLeftOfTheOneBefore) {
  const PinholeCamera camera = smallCamera();
  const TexturedPlane scene;
  const FramePtr frame = scene.render(camera, SE3(), {FrameId{0}});
  const std::vector<DepthSample> samples = scene.samples(camera, SE3(), 5, 0.25F);
  TrackingReferenceBuilder builder(camera);
  TrackingReference used{frame, camera, {}};
  builder.fill(scene.samples(camera, SE3(), 3), used);
  builder.fill(samples, used);
  const TrackingReference fresh = referenceOf(frame, camera, samples);
  for (int l = 0; l < fresh.levels(); ++l) {
    EXPECT_EQ(used.at(l).ray_x, fresh.at(l).ray_x) << l;
    EXPECT_EQ(used.at(l).inverse_depth, fresh.at(l).inverse_depth) << l;
  }
}

}  // namespace
}  // namespace dsorb::track
