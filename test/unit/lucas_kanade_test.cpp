// SPDX-License-Identifier: BSD-3-Clause
#include "features/lucas_kanade.h"

#include "support/painted_frame.h"

#include <gtest/gtest.h>
#include <opencv2/video/tracking.hpp>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace dsorb::init_orb {
namespace {

constexpr int kFlowWidth = 320;
constexpr int kFlowHeight = 240;

FlowPyramid pyramidOf(const Paint& intensity, float gain = 1) {
  const FramePtr frame = paintFrame(0, kFlowWidth, kFlowHeight, intensity);
  FlowPyramid pyramid;
  EXPECT_TRUE(pyramid.build(frame->level(0), gain, {}));
  return pyramid;
}

TEST(FlowPyramid, HalvesWhilePixelsStayOnEvenOnes) {
  const FlowPyramid pyramid = pyramidOf([](float x, float y) { return 0.3F * x + 0.2F * y; }, 2);
  ASSERT_EQ(pyramid.levels().size(), 4U);  // the next one is smaller than the window
  EXPECT_EQ(pyramid.levels()[3].width, 40);
  EXPECT_EQ(pyramid.levels()[3].height, 30);
  for (std::size_t l = 0; l < 4; ++l) {
    const auto scale = static_cast<float>(1 << l);
    EXPECT_NEAR(pyramid.levels()[l].row(10)[20], 2 * (0.3F * 20 + 0.2F * 10) * scale, 0.01F) << l;
  }
}

TEST(FlowPyramid, MirrorsTheImageAndClearsInvalidPixels) {
  const FramePtr frame = paintFrame(0, kFlowWidth, kFlowHeight, [](float x, float y) {
    return x == 5 && y == 3 ? std::numeric_limits<float>::quiet_NaN() : 10 * x + y;
  });
  FlowPyramid pyramid;
  EXPECT_FALSE(pyramid.build(frame->level(0), 1, {}));
  const FlowLevel& level = pyramid.levels().front();
  EXPECT_EQ(level.row(3)[5], 0);
  EXPECT_EQ(level.row(3)[300], 255);  // saturated
  EXPECT_EQ(level.row(-2)[4], level.row(2)[4]);
  EXPECT_EQ(level.row(7)[-3], level.row(7)[3]);
  EXPECT_EQ(level.row(kFlowHeight + 1)[-1], level.row(kFlowHeight - 3)[1]);
}

TEST(LucasKanade, FindsAShiftAcrossLevels) {
  const Paint scene = blobs(11);
  const FlowPyramid from = pyramidOf(scene);
  const FlowPyramid to = pyramidOf(shifted(scene, 9.4F, -6.7F));
  LucasKanade lucas_kanade({});
  for (int y = 60; y < 200; y += 20) {
    for (int x = 60; x < 260; x += 20) {
      Eigen::Vector2f place(static_cast<float>(x) + 0.3F, static_cast<float>(y) - 0.2F);
      const Eigen::Vector2f expected = place + Eigen::Vector2f(9.4F, -6.7F);
      ASSERT_TRUE(lucas_kanade.follow(from, to, place)) << x << " " << y;
      EXPECT_LT((place - expected).norm(), 0.1F) << x << " " << y;  // measured .05 and below
    }
  }
}

TEST(LucasKanade, RefusesWhatHasNoTextureOrLiesOutside) {
  const FlowPyramid flat = pyramidOf([](float, float) { return 90.0F; });
  const FlowPyramid edge = pyramidOf([](float x, float) { return x < 150 ? 50.0F : 150.0F; });
  const FlowPyramid scene = pyramidOf(blobs(12));
  LucasKanade lucas_kanade({});
  Eigen::Vector2f place(150, 120);
  EXPECT_FALSE(lucas_kanade.follow(flat, scene, place));
  EXPECT_FALSE(lucas_kanade.follow(edge, edge, place));  // an edge alone does not hold a point
  place = {-40, 120};
  EXPECT_FALSE(lucas_kanade.follow(scene, scene, place));
  place = {std::numeric_limits<float>::quiet_NaN(), 120};
  EXPECT_FALSE(lucas_kanade.follow(scene, scene, place));
}

/// Level 0 of a painted scene as OpenCV takes it.
cv::Mat eightBit(const Paint& scene) {
  cv::Mat grey(kFlowHeight, kFlowWidth, CV_8UC1);
  for (int y = 0; y < kFlowHeight; ++y) {
    for (int x = 0; x < kFlowWidth; ++x) {
      grey.at<unsigned char>(y, x) = static_cast<unsigned char>(
          std::lround(scene(static_cast<float>(x), static_cast<float>(y))));
    }
  }
  return grey;
}

TEST(LucasKanade, FindsWhatOpenCvFinds) {
  const Paint scene = blobs(14);
  const Paint moved = shifted(scene, 5.3F, 2.6F);
  const FlowPyramid from = pyramidOf(scene);
  const FlowPyramid to = pyramidOf(moved);
  std::vector<cv::Point2f> places;
  for (int y = 40; y < 200; y += 10) {
    for (int x = 40; x < 280; x += 10) {
      places.emplace_back(static_cast<float>(x) + 0.25F, static_cast<float>(y) + 0.5F);
    }
  }
  std::vector<cv::Point2f> theirs;
  std::vector<unsigned char> found;
  const cv::TermCriteria stop(cv::TermCriteria::COUNT + cv::TermCriteria::EPS, 30, 0.01);
  cv::calcOpticalFlowPyrLK(
      eightBit(scene), eightBit(moved), places, theirs, found, cv::noArray(), {21, 21}, 4, stop);
  LucasKanade lucas_kanade({});
  float worst = 0;
  float worst_error = 0;
  for (std::size_t i = 0; i < places.size(); ++i) {
    Eigen::Vector2f ours(places[i].x, places[i].y);
    ASSERT_TRUE(lucas_kanade.follow(from, to, ours));
    ASSERT_EQ(found[i], 1);
    const Eigen::Vector2f opencv(theirs[i].x, theirs[i].y);
    worst = std::max(worst, (ours - opencv).norm());
    worst_error = std::max(worst_error,
                           (ours - Eigen::Vector2f(places[i].x + 5.3F, places[i].y + 2.6F)).norm());
  }
  EXPECT_LT(worst, 0.01F);        // measured 0.0044
  EXPECT_LT(worst_error, 0.04F);  // measured 0.019
}

}  // namespace
}  // namespace dsorb::init_orb
