// SPDX-License-Identifier: BSD-3-Clause
// A patch is found where another view moves, stretches, turns and shears it.
#include "self_calibration/shaped_patch.h"

#include "support/painted_frame.h"

#include <Eigen/LU>
#include <gtest/gtest.h>

namespace dsorb::self_calibration {
namespace {

constexpr int kWidth = 320;
constexpr int kHeight = 240;
const Eigen::Vector2f kOrigin(150, 110);

FlowPyramid pyramidOf(const Paint& intensity) {
  FlowPyramid pyramid;
  EXPECT_TRUE(pyramid.build(paintFrame(0, kWidth, kHeight, intensity)->level(0), 1, {}));
  return pyramid;
}

/// A scene from elsewhere, brighter by some grey levels.
Paint seenAt(const Paint& scene, const PatchPose& pose) {
  return [scene, pose, inverse = Eigen::Matrix2f(pose.shape.inverse())](float x, float y) {
    const Eigen::Vector2f p = kOrigin + inverse * (Eigen::Vector2f(x, y) - pose.place);
    return scene(p.x(), p.y()) + 5;
  };
}

TEST(ShapedPatch, IsFoundWhereAViewMovesAndShapesIt) {
  for (unsigned seed = 1; seed <= 8; ++seed) {
    SCOPED_TRACE(seed);
    const Paint scene = blobs(seed);
    const FlowPyramid host = pyramidOf(scene);
    PatchPose truth{{163.4F, 98.7F}, {}};
    truth.shape << 1.25F, 0.15F, -0.1F, 1.1F;
    const FlowPyramid image = pyramidOf(seenAt(scene, truth));
    const ShapedPatch patch(host.levels().front(), kOrigin);
    PatchPose pose{truth.place + Eigen::Vector2f(0.6F, -0.4F), Eigen::Matrix2f::Identity()};
    ASSERT_TRUE(patch.align(image.levels().front(), pose));
    EXPECT_LT((pose.place - truth.place).norm(), 0.03F);
    EXPECT_LT((pose.shape - truth.shape).norm(), 0.02F);
  }
}

TEST(ShapedPatch, IsNotFoundInAnotherSceneOrAtTheBorder) {
  const Paint scene = blobs(3);
  const FlowPyramid host = pyramidOf(scene);
  const FlowPyramid other = pyramidOf(blobs(4));
  const ShapedPatch patch(host.levels().front(), kOrigin);
  PatchPose pose{kOrigin, Eigen::Matrix2f::Identity()};
  EXPECT_FALSE(patch.align(other.levels().front(), pose));
  pose = {{5, 110}, Eigen::Matrix2f::Identity()};
  EXPECT_FALSE(patch.align(host.levels().front(), pose));
}

}  // namespace
}  // namespace dsorb::self_calibration
