// SPDX-License-Identifier: BSD-3-Clause
#include "odometry/segment_unit.h"

#include "support/matchers.h"

#include <gtest/gtest.h>

#include <optional>
#include <vector>

namespace dsorb::odometry {
namespace {

const SE3 kPose(Eigen::Quaterniond(Eigen::AngleAxisd(.3, Eigen::Vector3d(1, 2, 3).normalized())),
                {1, -2, 3});

FrameEstimate estimate() {
  FrameEstimate estimate;
  estimate.T_world_cam = kPose;
  estimate.T_cam_keyframe = kPose.inverse();
  estimate.covariance = Matrix6d::Identity() + Matrix6d::Constant(.5);
  estimate.world_covariance = 2 * *estimate.covariance;
  return estimate;
}

std::vector<KeyframeSnapshot> keyframes() {
  KeyframeSnapshot keyframe;
  keyframe.camera = {100, 100, 50, 40, 100, 80};
  keyframe.T_world_cam = kPose;
  keyframe.points = {{{20, 30}, .5F, .04F, 90}, {{70, 60}, 2, 0, 10}};
  return {keyframe};
}

Eigen::Vector3d place(const KeyframeSnapshot& keyframe, const MapPoint& point) {
  return keyframe.T_world_cam *
         Eigen::Vector3d(keyframe.camera.unproject(point.pixel.cast<double>()) /
                         static_cast<double>(point.inverse_depth));
}

TEST(SegmentUnit, PosesAndTheirCovarianceAreInMetres) {
  const FrameEstimate start = estimate();
  const FrameEstimate told = SegmentUnit(MetricScale{4, .01, 100}).told(start);
  EXPECT_EQ(told.T_world_cam->translation(), 4 * kPose.translation());
  EXPECT_EQ(told.T_cam_keyframe->translation(), 4 * start.T_cam_keyframe->translation());
  EXPECT_EQ(told.T_world_cam->rotationMatrix(), kPose.rotationMatrix());
  EXPECT_EQ((*told.covariance)(0, 0), 16 * 1.5);  // m^2
  EXPECT_EQ((*told.covariance)(1, 4), 4 * .5);    // m rad
  EXPECT_EQ((*told.covariance)(4, 1), 4 * .5);
  EXPECT_EQ((*told.covariance)(5, 5), 1.5);  // rad^2
  EXPECT_EQ(*told.world_covariance, 2 * *told.covariance);
}

TEST(SegmentUnit, KeyframesAndPointsGrowAlike) {
  const KeyframeSnapshot start = keyframes().front();
  const KeyframeSnapshot told = SegmentUnit(MetricScale{4, .01, 100}).told(keyframes()).front();
  EXPECT_EQ(told.T_world_cam.translation(), 4 * kPose.translation());
  for (std::size_t i = 0; i < start.points.size(); ++i) {
    EXPECT_LT((place(told, told.points[i]) - 4 * place(start, start.points[i])).norm(), 1e-12);
    EXPECT_EQ(told.points[i].pixel, start.points[i].pixel);
    EXPECT_EQ(told.points[i].intensity, start.points[i].intensity);
  }
  EXPECT_EQ(told.points[0].variance, .04F / 16) << "1/m^2";
  EXPECT_EQ(told.points[1].variance, 0) << "unknown stays unknown";
}

TEST(SegmentUnit, WithoutAScaleNothingMoves) {
  for (const SegmentUnit& unit : {SegmentUnit(), SegmentUnit(std::optional<MetricScale>())}) {
    const FrameEstimate told = unit.told(estimate());
    EXPECT_EQ(told.T_world_cam->translation(), kPose.translation());
    EXPECT_EQ(*told.covariance, *estimate().covariance);
    EXPECT_EQ(unit.told(keyframes()).front().points[0].inverse_depth, .5F);
  }
}

}  // namespace
}  // namespace dsorb::odometry
