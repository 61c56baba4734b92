// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/io/sequence_reader.h"

#include "io/input/pixel_patterns.h"
#include "support/image_folder.h"
#include "support/temporary_folder.h"

#include <gmock/gmock.h>

#include <cmath>
#include <optional>
#include <vector>

namespace dsorb {
namespace {

constexpr int kBarWidth = 20;

/// 160 x 120 px with bars of a grey level beside a picture.
cv::Mat pictured(int left, int right, int top = 0, int bottom = 0, int black = 0) {
  cv::Mat image(120, 160, CV_8UC1, cv::Scalar(black));
  cv::Mat picture = image(cv::Range(top, 120 - bottom), cv::Range(left, 160 - right));
  cv::randu(picture, 60, 200);
  return image;
}

BlackBars barsOf(const cv::Mat& image) {
  BarFinder finder;
  finder.look(image);
  return finder.bars();
}

TEST(BlackBars, AreFoundAtOppositeSides) {
  const BlackBars sides = barsOf(pictured(20, 21));
  EXPECT_EQ(sides.left, 20);
  EXPECT_EQ(sides.right, 21);
  EXPECT_EQ(sides.top, 0);
  const BlackBars all = barsOf(pictured(20, 20, 10, 10, 16));
  EXPECT_EQ(all.left, 20);
  EXPECT_EQ(all.bottom, 10);
  const cv::Mat grey = pictured(0, 0, 15, 15);
  cv::Mat colour;
  cv::merge(std::vector<cv::Mat>{grey, grey, grey}, colour);
  EXPECT_EQ(barsOf(colour).top, 15);
}

TEST(BlackBars, AreNotWhatTheSceneMayShow) {
  EXPECT_FALSE(barsOf(pictured(20, 0)).any()) << "a dark wall";
  EXPECT_FALSE(barsOf(pictured(20, 40)).any()) << "two of them";
  EXPECT_FALSE(barsOf(pictured(20, 20, 0, 0, 40)).any()) << "grey";
  cv::Mat noisy = pictured(20, 20);
  cv::randu(noisy.colRange(0, 20), 0, 24);
  EXPECT_FALSE(barsOf(noisy).any());
  EXPECT_FALSE(barsOf(cv::Mat(120, 160, CV_16UC1, cv::Scalar(0))).any());
}

TEST(BlackBars, AreBlackInAllImages) {
  BarFinder finder;
  EXPECT_FALSE(finder.look(cv::Mat(120, 160, CV_8UC1, cv::Scalar(0)))) << "tells nothing";
  EXPECT_FALSE(finder.look(pictured(70, 70))) << "neither";
  EXPECT_TRUE(finder.look(pictured(30, 31)));
  EXPECT_TRUE(finder.look(pictured(20, 20)));
  EXPECT_FALSE(finder.look(pictured(25, 25)));
  EXPECT_EQ(finder.bars().left, 20);
  EXPECT_TRUE(finder.look(pictured(0, 0)));
  EXPECT_FALSE(finder.look(pictured(20, 20))) << "the first images were dark there";
  EXPECT_FALSE(finder.bars().any());
}

TEST(BlackBars, AreHiddenWithTheirEdge) {
  const BlackBars bars = barsOf(pictured(kBarWidth, kBarWidth));
  const cv::Mat kept = withoutBars(bars, {160, 120}, {});
  EXPECT_EQ(kept.at<uchar>(60, kBarWidth + 7), 0);
  EXPECT_EQ(kept.at<uchar>(0, kBarWidth + 8), 255);
  cv::Mat mask(120, 160, CV_8UC1, cv::Scalar(255));
  mask.rowRange(0, 60) = 0;
  const cv::Mat both = withoutBars(bars, {160, 120}, mask);
  EXPECT_EQ(both.at<uchar>(59, 80), 0);
  EXPECT_EQ(both.at<uchar>(60, 80), 255);
  EXPECT_EQ(both.at<uchar>(60, 2), 0);
  EXPECT_TRUE(withoutBars({}, {160, 120}, {}).empty());
  EXPECT_EQ(cv::countNonZero(withoutBars(bars, {160, 120}, cv::Mat::zeros(120, 160, CV_8U))), 0);
}

TEST(BlackBars, OfASequenceAreInvalidInItsFrames) {
  const TemporaryFolder folder;
  for (int i = 0; i < 3; ++i) {
    writeImage(folder.path() / "images" / fmt::format("{:05d}.png", i),
               pictured(kBarWidth, kBarWidth));
  }
  writeText(folder.path() / "camera.txt", "Pinhole 100 100 79.5 59.5 0\n160 120\nnone\n160 120\n");
  SequenceOptions options;
  options.path = folder.path().string();
  SequenceReader reader(options);
  for (int i = 0; i < 3; ++i) {
    const std::optional<SequenceFrame> read = reader.next();
    ASSERT_TRUE(read);
    const PyramidLevel& image = read->frame->level(0);
    EXPECT_TRUE(std::isnan(image.intensity(kBarWidth + 5, 60)));
    EXPECT_TRUE(std::isnan(image.intensity(159, 0)));
    EXPECT_FALSE(std::isnan(image.intensity(80, 60)));
    if (i == 0) {
      EXPECT_THAT(read->warnings, testing::ElementsAre(testing::HasSubstr("black bars (20 px")));
    } else {
      EXPECT_THAT(read->warnings, testing::IsEmpty());
    }
  }
}

}  // namespace
}  // namespace dsorb
