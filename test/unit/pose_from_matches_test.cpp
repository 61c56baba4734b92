// SPDX-License-Identifier: BSD-3-Clause
#include "features/pose_from_matches.h"

#include "support/matchers.h"
#include "support/painted_frame.h"
#include "support/two_view_scene.h"

#include <gtest/gtest.h>

#include <vector>

namespace dsorb {
namespace {

std::vector<PointObservation> matchesOf(const TwoViewScene& scene) {
  std::vector<PointObservation> matches;
  for (std::size_t i = 0; i < scene.matches.size(); ++i) {
    matches.push_back({scene.camera.unproject(scene.matches.reference[i]),
                       scene.inverse_depth[i],
                       scene.matches.target[i]});
  }
  return matches;
}

TEST(PoseFromMatches, FindsThePoseAmongTwoThirdsOfWrongMatchesWithoutAGuess) {
  double squared = 0;  // error over covariance, a sixth
  for (std::uint64_t seed = 1; seed <= 30; ++seed) {
    auto scene = makeTwoViewScene({300, false, {2.5, 0.4, -1.5}, 1, 0.67}, seed);
    const auto pose = poseFromMatches(matchesOf(scene), scene.camera, seed);
    ASSERT_TRUE(pose);
    EXPECT_THAT(pose->T_cam_host, Se3Near(scene.T_cur_ref, 0.5, 0.1));
    EXPECT_NEAR(pose->noise, 1, 0.3);
    EXPECT_NEAR(pose->inliers, 100, 30);
    const Vector6d error = (scene.T_cur_ref * pose->T_cam_host.inverse()).log();
    squared += error.dot(pose->covariance.inverse() * error) / (6 * 30);
  }
  EXPECT_NEAR(squared, 1, 0.5);
}

TEST(PoseFromMatches, IsTheSameForTheSameSeed) {
  const auto scene = makeTwoViewScene({200, false, {1, 0, 0}, 1, 0.5}, 3);
  const auto a = poseFromMatches(matchesOf(scene), scene.camera, 7);
  const auto b = poseFromMatches(matchesOf(scene), scene.camera, 7);
  ASSERT_TRUE(a && b);
  EXPECT_EQ(a->T_cam_host.translation(), b->T_cam_host.translation());
}

TEST(PoseFromMatches, RefusesMatchesThatContradictEachOther) {
  for (std::uint64_t seed = 1; seed <= 30; ++seed) {
    const auto scene = makeTwoViewScene({400, false, {0.6, 0.1, 0.3}, 0, 1}, seed);
    EXPECT_FALSE(poseFromMatches(matchesOf(scene), scene.camera, seed)) << seed;
  }
  EXPECT_FALSE(poseFromMatches({}, PinholeCamera{}, 1));
}

TEST(PoseFromMatches, OfImagesFarApart) {
  const PinholeCamera camera{400, 400, 240, 180, 480, 360};
  const Eigen::Vector2f shift(97.3F, -61.6F);
  const Paint scene = blobs(1);
  const auto describe = [&](const Paint& paint) {
    return describeFrame(paintFrame(0, camera.width, camera.height, paint), 1);
  };
  std::vector<DepthSample> wall;
  for (int y = 3; y < camera.height; y += 6) {
    for (int x = 3; x < camera.width; x += 6) {
      wall.push_back({{static_cast<float>(x), static_cast<float>(y)}, 0.5F});
    }
  }
  const DescribedPoints points = describePoints(describe(scene), wall);
  const auto matches = matchPoints(points, describe(shifted(scene, shift.x(), shift.y())), camera);
  const auto pose = poseFromMatches(matches, camera, 1);
  ASSERT_TRUE(pose);
  const Eigen::Vector3d moved(2 * shift.x() / camera.fx, 2 * shift.y() / camera.fy, 0);
  EXPECT_THAT(pose->T_cam_host, Se3Near(SE3(so3Exp({0, 0, 0}), moved), 0.2, 0.01));
  EXPECT_TRUE(matchPoints(describePoints(describe(scene), {}), describe(scene), camera).empty());
}

}  // namespace
}  // namespace dsorb
