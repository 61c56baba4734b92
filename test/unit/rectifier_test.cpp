// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/camera/rectifier.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/imgproc.hpp>

#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>
#include <vector>

namespace dsorb {
namespace {

using testing::AllOf;
using testing::HasSubstr;

constexpr int kLensWidth = 70;  // no multiple of 16
constexpr int kLensHeight = 50;

Calibration plainLens() {
  Calibration calibration;
  calibration.lens = {LensModel::kPinhole, 60, 60, 34.5, 24.5, {}, kLensWidth, kLensHeight};
  calibration.rectification.mode = RectificationMode::kNone;
  return calibration;
}

cv::Mat noise(int type) {
  cv::Mat image(kLensHeight, kLensWidth, type);
  cv::theRNG().state = 1;
  cv::randu(image, cv::Scalar::all(0), cv::Scalar::all(256));
  return image;
}

template <typename Function>
std::string complaint(const Function& function) {
  try {
    function();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "nothing was thrown";
}

TEST(Rectifier, GreyImagesAreCroppedToMultiplesOfSixteen) {
  Rectifier rectifier(plainLens());
  EXPECT_EQ(rectifier.camera().width, 64);
  EXPECT_EQ(rectifier.camera().height, 48);
  EXPECT_EQ(rectifier.camera().cx, 34.5);
  const cv::Mat image = noise(CV_8UC1);
  const FramePtr frame =
      rectifier.frame(rawImage(image), {FrameId{7}, secondsFromNanoseconds(1500000000)});
  EXPECT_EQ(frame->id().value, 7);
  EXPECT_EQ(frame->timestamp(), 1.5);
  EXPECT_EQ(frame->width(), 64);
  EXPECT_EQ(frame->level(0).at(63, 47).intensity, image.at<std::uint8_t>(47, 63));
  EXPECT_EQ(frame->responseSlope(), nullptr);
}

TEST(Rectifier, FramesKnowTheTimesOfTheirRows) {
  Calibration calibration = plainLens();
  const cv::Mat image = noise(CV_8UC1);
  EXPECT_EQ(Rectifier(calibration).frame(rawImage(image), {})->rowTimes(), nullptr);
  calibration.lens.readout = {0.02, 0};
  Rectifier rolling(calibration);
  const FramePtr frame = rolling.frame(rawImage(image), {});
  ASSERT_NE(frame->rowTimes(), nullptr);
  EXPECT_EQ(frame->rowTimes(), rolling.rowTimes().get());
  EXPECT_NEAR(frame->rowTimes()->at(10, 0), -0.01, 1e-12);
  EXPECT_NEAR(frame->rowTimes()->at(10, 47), 0.02 * (47.0 / 49 - 0.5), 1e-12);  // of 50 rows
}

TEST(Rectifier, ColourIsTheGreyOfOpenCv) {
  Rectifier rectifier(plainLens());
  const cv::Mat bgr = noise(CV_8UC3);
  cv::Mat rgb;
  cv::Mat grey;
  cv::cvtColor(bgr, rgb, cv::COLOR_BGR2RGB);
  cv::cvtColor(bgr, grey, cv::COLOR_BGR2GRAY);
  RawImage swapped = rawImage(rgb);
  swapped.format = PixelFormat::kRgb8;
  const FramePtr from_bgr = rectifier.frame(rawImage(bgr), {FrameId{0}});
  const FramePtr from_rgb = rectifier.frame(swapped, {FrameId{1}});
  for (int y = 0; y < 48; ++y) {
    for (int x = 0; x < 64; ++x) {
      // OpenCV's weights have 14 bits, ours 16: a sum near a half may round differently.
      ASSERT_NEAR(from_bgr->level(0).at(x, y).intensity, grey.at<std::uint8_t>(y, x), 1);
      ASSERT_EQ(from_bgr->level(0).at(x, y).intensity, from_rgb->level(0).at(x, y).intensity);
    }
  }
}

TEST(Rectifier, RowsMayLieApart) {
  Rectifier rectifier(plainLens());
  const cv::Mat wide(kLensHeight, 2 * kLensWidth, CV_8UC1, cv::Scalar(9));
  cv::Mat part = wide(cv::Rect(10, 0, kLensWidth, kLensHeight));
  noise(CV_8UC1).copyTo(part);
  const FramePtr frame = rectifier.frame(rawImage(part), {FrameId{0}});
  EXPECT_EQ(frame->level(0).at(20, 30).intensity, part.at<std::uint8_t>(30, 20));
}

TEST(Rectifier, SixteenBitsAreSpreadOverTheBitsThatAreUsed) {
  Rectifier rectifier(plainLens());
  const cv::Mat image(kLensHeight, kLensWidth, CV_16UC1, cv::Scalar(1023));
  EXPECT_NEAR(
      rectifier.frame(rawImage(image), {FrameId{0}})->level(0).at(5, 5).intensity, 3.98, 0.01);
  rectifier.setBits(10);
  EXPECT_EQ(rectifier.frame(rawImage(image), {FrameId{1}})->level(0).at(5, 5).intensity, 255);
  EXPECT_THAT(complaint([&] { rectifier.setBits(8); }), HasSubstr("9 to 16"));
}

TEST(Rectifier, ResponseAndVignetteMayComeAlone) {
  Calibration curved = plainLens();
  for (int i = 0; i < 256; ++i)
    curved.photometric.response.push_back(static_cast<float>(i * i) / 255);
  const cv::Mat image(kLensHeight, kLensWidth, CV_8UC1, cv::Scalar(51));
  const FramePtr frame = Rectifier(curved).frame(rawImage(image), {FrameId{0}});
  EXPECT_NEAR(frame->level(0).at(3, 3).intensity, 51 * 51 / 255.0, 1e-4);
  EXPECT_NE(frame->responseSlope(), nullptr);

  Calibration dark = plainLens();
  dark.photometric.vignette.assign(kLensWidth * kLensHeight, 0.5F);
  dark.photometric.vignette_width = kLensWidth;
  dark.photometric.vignette_height = kLensHeight;
  EXPECT_EQ(Rectifier(dark).frame(rawImage(image), {FrameId{0}})->level(0).at(3, 3).intensity, 102);
}

TEST(Rectifier, MaskedPixelsAreInvalidAlsoAfterUndistortion) {
  Calibration fov = plainLens();
  fov.lens.model = LensModel::kFov;
  fov.lens.coefficients[0] = 0.9;
  fov.rectification.mode = RectificationMode::kCrop;
  for (const Calibration& calibration : {plainLens(), fov}) {
    Rectifier rectifier(calibration);
    const int width = rectifier.camera().width;
    const int height = rectifier.camera().height;
    // The masked half is bright: none of its light may be left beside the border.
    cv::Mat image(kLensHeight, kLensWidth, CV_8UC1, cv::Scalar(10));
    image.rowRange(30, kLensHeight).setTo(250);
    cv::Mat mask(kLensHeight, kLensWidth, CV_8UC1, cv::Scalar(255));
    mask.rowRange(30, kLensHeight).setTo(0);
    const ImageView view(mask.data, kLensWidth, kLensHeight);
    const auto check = [&](const FramePtr& frame) {
      int invalid = 0;
      for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
          const float intensity = frame->level(0).at(x, y).intensity;
          if (std::isnan(intensity)) ++invalid;
          ASSERT_TRUE(std::isnan(intensity) || intensity == 10) << x << " " << y;
        }
      }
      EXPECT_GT(invalid, width * height / 4);
      EXPECT_LT(invalid, width * height / 2);
    };
    check(rectifier.frame(rawImage(image), {FrameId{0}}, view));  // this one only
    EXPECT_EQ(rectifier.frame(rawImage(image), {FrameId{1}})->level(0).at(5, height - 1).intensity,
              250);
    rectifier.setMask(view);
    check(rectifier.frame(rawImage(image), {FrameId{2}}));
    EXPECT_THROW(rectifier.setMask(ImageView(mask.data, kLensWidth, kLensHeight - 1)),
                 std::invalid_argument);
    check(
        rectifier.frame(rawImage(image), {FrameId{2}}));  // a mask that is refused changes nothing
    rectifier.setMask({});
    EXPECT_EQ(rectifier.frame(rawImage(image), {FrameId{3}})->level(0).at(5, height - 1).intensity,
              250);
  }
}

TEST(Rectifier, RefusesWithTheReason) {
  Rectifier rectifier(plainLens());
  const cv::Mat small(kLensHeight, kLensWidth - 1, CV_8UC1, cv::Scalar(0));
  EXPECT_THAT(complaint([&] { (void)rectifier.rectify(rawImage(small)); }),
              AllOf(HasSubstr("69x50"), HasSubstr("expected 70x50")));
  EXPECT_THAT(complaint([&] { (void)rectifier.rectify({}); }), HasSubstr("empty"));
  RawImage narrow = rawImage(noise(CV_8UC3));
  narrow.stride_bytes = 3 * kLensWidth - 1;
  EXPECT_THAT(complaint([&] { (void)rectifier.rectify(narrow); }), HasSubstr("210 bytes"));
  EXPECT_THAT(complaint([&] { (void)rawImage(noise(CV_32FC1)); }), HasSubstr("CV_8UC1"));
  EXPECT_THAT(complaint([&] {
                rectifier.setMask({small.data, kLensWidth - 1, kLensHeight});
              }),
              AllOf(HasSubstr("69x50"), HasSubstr("70x50")));
  const cv::Mat black(kLensHeight, kLensWidth, CV_8UC1, cv::Scalar(0));
  EXPECT_THAT(complaint([&] {
                rectifier.setMask({black.data, kLensWidth, kLensHeight});
              }),
              HasSubstr("black everywhere"));

  Calibration sizeless = plainLens();
  sizeless.lens.width = 0;
  EXPECT_THAT(complaint([&] { Rectifier{sizeless}; }), HasSubstr("no image size"));
  Calibration tiny = plainLens();
  tiny.lens.width = 15;
  tiny.lens.cx = 7;
  EXPECT_THAT(complaint([&] { Rectifier{tiny}; }), HasSubstr("at least 16x16"));
  for (const double focal : {0.0, -60.0, std::nan(""), std::numeric_limits<double>::infinity()}) {
    Calibration wrong = plainLens();
    wrong.lens.fx = focal;
    EXPECT_THAT(complaint([&] { Rectifier{wrong}; }), HasSubstr("focal length"));
  }
}

TEST(CalibrationSizes, ANinetyDegreeLensHasHalfItsWidthAsFocalLength) {
  const Lens lens = lensOfFieldOfView(90, 640, 480);
  EXPECT_NEAR(lens.fx, 320, 1e-9);
  EXPECT_NEAR(lens.fy, 320, 1e-9);
  EXPECT_EQ(lens.cx, 319.5);
  EXPECT_EQ(lens.cy, 239.5);
  EXPECT_THAT(complaint([] { (void)lensOfFieldOfView(180, 640, 480); }), HasSubstr("1 to 157"));
}

TEST(CalibrationSizes, HalfTheImageHasHalfTheFocalLength) {
  Calibration full;
  full.lens = {LensModel::kRadTan, 1000, 1001, 639.5, 359.5, {-.1}, 1280, 720};
  full.rectification = {RectificationMode::kExplicit, 640, 360, {500, 500, 319.5, 179.5, 0, 0}};
  const Calibration half = calibrationForSize(full, 640, 360);
  EXPECT_EQ(half.lens.fx, 500);
  EXPECT_EQ(half.lens.fy, 500.5);
  EXPECT_EQ(half.lens.cx, 319.5);
  EXPECT_EQ(half.lens.cy, 179.5);
  EXPECT_EQ(half.lens.coefficients[0], -.1);
  EXPECT_EQ(half.rectification.width, 320);
  EXPECT_EQ(half.rectification.camera.fx, 250);
  EXPECT_EQ(calibrationForSize(full, 853, 480).lens.height, 480);  // rounded from 853.3
  EXPECT_THAT(complaint([&] { (void)calibrationForSize(full, 640, 480); }),
              AllOf(HasSubstr("1280x720"), HasSubstr("640x480"), HasSubstr("shape")));
  EXPECT_THAT(complaint([&] { (void)calibrationForSize(full, 720, 1280); }), HasSubstr("shape"));
}

TEST(CalibrationSizes, TheOutputIsMadeSmallerWithoutTouchingTheLens) {
  const Calibration small = withOutputWidth(plainLens(), 35);
  EXPECT_EQ(small.lens.width, kLensWidth);
  EXPECT_EQ(small.rectification.mode, RectificationMode::kExplicit);
  Rectifier rectifier(small);
  EXPECT_EQ(rectifier.camera().width, 32);
  EXPECT_EQ(rectifier.camera().height, 16);
  EXPECT_EQ(rectifier.camera().fx, 30);
  EXPECT_EQ(rectifier.camera().cx, 17);
  // Each pixel is the mean of 2 x 2: of stripes one pixel wide nothing but the mean is left.
  cv::Mat stripes(kLensHeight, kLensWidth, CV_8UC1, cv::Scalar(0));
  for (int x = 0; x < kLensWidth; x += 2) stripes.col(x).setTo(200);
  const FramePtr frame = rectifier.frame(rawImage(stripes), {FrameId{0}});
  EXPECT_NEAR(frame->level(0).at(10, 10).intensity, 100, 1e-3);
  EXPECT_THAT(complaint([] { (void)withOutputWidth(plainLens(), 71); }), HasSubstr("16 to 70"));
  EXPECT_EQ(withOutputWidth(plainLens(), kLensWidth).rectification.mode, RectificationMode::kNone);
  Calibration distorted = plainLens();  // which kNone would leave in the images
  distorted.lens.model = LensModel::kRadTan;
  distorted.lens.coefficients = {-.3, .1};
  EXPECT_THAT(complaint([&] { (void)Rectifier(distorted); }), HasSubstr("'none' would leave"));
}

}  // namespace
}  // namespace dsorb
