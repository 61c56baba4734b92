// SPDX-License-Identifier: BSD-3-Clause
#include "base/random.h"
#include "features/feature_tracks.h"
#include "support/painted_frame.h"

#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <cstdint>
#include <vector>

namespace dsorb::init_orb {
namespace {

constexpr int kHeight = 241;  // of three bands and a part of one
constexpr int kWidth = 320;

cv::Mat imageOf(const Paint& intensity) {
  cv::Mat grey(kHeight, kWidth, CV_8UC1);
  for (int y = 0; y < kHeight; ++y) {
    for (int x = 0; x < kWidth; ++x) {
      grey.at<std::uint8_t>(y, x) =
          static_cast<std::uint8_t>(intensity(static_cast<float>(x), static_cast<float>(y)));
    }
  }
  return grey;
}

void expectThoseOfOpenCv(const cv::Mat& grey, const cv::Mat& valid) {
  for (const double quality : {0.003, 0.1}) {
    std::vector<cv::Point2f> expected;
    cv::goodFeaturesToTrack(grey, expected, 0, quality, 0, valid);
    const std::vector<DetectedCorner> corners = detectCorners(grey, valid, quality);
    ASSERT_EQ(corners.size(), expected.size());
    for (std::size_t i = 0; i < corners.size(); ++i) {
      ASSERT_EQ(static_cast<float>(corners[i].x), expected[i].x) << i;
      ASSERT_EQ(static_cast<float>(corners[i].y), expected[i].y) << i;
    }
  }
}

TEST(CornerDetection, FindsThoseOfOpenCvInItsOrder) {
  expectThoseOfOpenCv(imageOf(blobs(1)), {});
}

TEST(CornerDetection, KeepsTheOrderOfEquallyStrongOnes) {
  const auto squares = [](float x, float y) {
    const bool odd = (static_cast<int>(x) / 7 + static_cast<int>(y) / 5) % 2 != 0;
    return odd ? 200.0F : 40.0F;
  };
  expectThoseOfOpenCv(imageOf(squares), {});
}

TEST(CornerDetection, LeavesOutWhatIsMasked) {
  Random random(2);
  const auto noise = [&](float, float) { return static_cast<float>(random.uniform(0, 255)); };
  const cv::Mat grey = imageOf(noise);
  cv::Mat valid(grey.size(), CV_8UC1, cv::Scalar(255));
  cv::circle(valid, {120, 64}, 50, cv::Scalar(0), cv::FILLED);
  expectThoseOfOpenCv(grey, valid);
  expectThoseOfOpenCv(grey, cv::Mat::zeros(grey.size(), CV_8UC1));
}

TEST(CornerDetection, FindsNoneWhereThereIsNoTexture) {
  EXPECT_TRUE(detectCorners(imageOf([](float, float) { return 128.0F; }), {}, 0.003).empty());
}

}  // namespace
}  // namespace dsorb::init_orb
