// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/error.h"
#include "dsorb/io/sequence_reader.h"

#include "support/sequence_fixture.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <string>

namespace dsorb {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

class SequenceSelectionTest : public SequenceFixture {
 protected:
  /// White but for one column, which is black.
  static cv::Mat maskOf(int column, int width = 64) {
    cv::Mat mask(48, width, CV_8U, cv::Scalar(255));
    mask.col(column).setTo(0);
    return mask;
  }
  static bool isMasked(const SequenceFrame& frame, int column) {
    return std::isnan(frame.frame->level(0).at(column, 20).intensity);
  }
};

TEST_F(SequenceSelectionTest, OneMaskForAllImages) {
  writeDso(2);
  writeImage(root() / "bonnet.png", maskOf(5));
  SequenceOptions o = options();
  o.mask = (root() / "bonnet.png").string();
  SequenceReader reader(o);
  for (const SequenceFrame& frame : readAll(reader)) {
    EXPECT_TRUE(isMasked(frame, 5));
    EXPECT_FALSE(isMasked(frame, 4));
  }
}

TEST_F(SequenceSelectionTest, MasksBesideTheImagesBelongToTheImageOfTheirName) {
  writeDso(3, ".jpg");
  writeImage(root() / "masks" / "000000.png", maskOf(10));
  writeImage(root() / "masks" / "000001.jpg.png", maskOf(20));
  writeImage(root() / "masks" / "000002.png", maskOf(30));
  writeImage(root() / "bonnet.png", maskOf(5));
  SequenceOptions o = options();
  o.mask = (root() / "bonnet.png").string();
  for (const bool common : {false, true}) {
    if (!common) o.mask.clear();
    if (common) o.mask = (root() / "bonnet.png").string();
    SequenceReader reader(o);
    const auto frames = readAll(reader);
    ASSERT_EQ(frames.size(), 3U);
    for (int i = 0; i < 3; ++i) {
      const SequenceFrame& frame = frames[static_cast<std::size_t>(i)];
      for (int other = 0; other < 3; ++other) {
        EXPECT_EQ(isMasked(frame, 10 * (other + 1)), i == other);
      }
      EXPECT_EQ(isMasked(frame, 5), common);
    }
  }
}

TEST_F(SequenceSelectionTest, MissingAndWrongMasksAreNamed) {
  writeDso(2);
  SequenceOptions o = options();
  o.mask = (root() / "none.png").string();
  EXPECT_THAT(openingComplaint(o), AllOf(HasSubstr("none.png"), HasSubstr("no such mask")));
  o.mask = (root() / "small.png").string();
  writeImage(o.mask, maskOf(3, 62));
  EXPECT_THAT(
      openingComplaint(o),
      AllOf(HasSubstr("small.png"), HasSubstr("62x48 px; expected the size of the images, 64x48")));
  writeImage(o.mask, cv::Mat(48, 64, CV_8U, cv::Scalar(0)));
  EXPECT_THAT(openingComplaint(o), AllOf(HasSubstr("small.png"), HasSubstr("black everywhere")));
  writeImage(o.mask, cv::Mat(48, 64, CV_16U, cv::Scalar(0)));
  EXPECT_THAT(openingComplaint(o), HasSubstr("8 bits"));
  o.mask.clear();
  writeImage(root() / "masks" / "000000.png", maskOf(10));
  EXPECT_THAT(readingComplaint(o), AllOf(HasSubstr("no mask for"), HasSubstr("000001.png")));
  writeText(root() / "masks" / "000001.png", "no image");
  EXPECT_THAT(readingComplaint(o), AllOf(HasSubstr("masks/000001.png"), HasSubstr("decoded")));
}

TEST_F(SequenceSelectionTest, SecondsAndEverySelectImages) {
  writeDso(20);  // 0.1 s apart
  SequenceOptions o = options();
  o.from = 0.45;
  o.to = 1.2;
  o.every = 3;
  const auto indices = [](const SequenceOptions& selected) {
    SequenceReader reader(selected);
    std::vector<int> found;
    for (const SequenceFrame& frame : readAll(reader)) found.push_back(frame.index);
    return found;
  };
  EXPECT_EQ(indices(o), (std::vector<int>{5, 8, 11}));
  o.reverse = true;
  EXPECT_EQ(indices(o), (std::vector<int>{12, 9, 6}));
  o.every = std::numeric_limits<int>::max();
  EXPECT_EQ(indices(o), (std::vector<int>{12}));
  o.from = 1.95;
  o.to = 0;
  EXPECT_THROW(SequenceReader{o}, ConfigError);
  EXPECT_THAT(openingComplaint(o), HasSubstr("no image is selected; the sequence takes 1.9 s"));
}

TEST_F(SequenceSelectionTest, WithoutCalibrationTheCameraIsAGuess) {
  writeGreyImages(root() / "images", 2, ".png");
  SequenceOptions o = options();
  SequenceReader unknown(o);
  EXPECT_EQ(unknown.camera().focal_sigma, PinholeCamera::unknown(64, 32).focal_sigma);
  EXPECT_EQ(unknown.camera().fx, PinholeCamera::unknown(64, 32).fx);
  o.horizontal_view = 90;
  SequenceReader reader(o);
  EXPECT_NEAR(reader.camera().fx, 32, 1e-9);
  o.width = 32;
  SequenceReader small(o);
  EXPECT_NEAR(small.camera().fx, 16, 1e-9);
  EXPECT_EQ(small.camera().width, 32);
  EXPECT_EQ(small.camera().height, 16);
  EXPECT_EQ(readAll(small)[1].frame->level(0).at(7, 7).intensity, 10);
}

TEST_F(SequenceSelectionTest, ACalibrationForAnotherSizeIsScaledOrRefused) {
  writeDso(1);
  writeText(root() / "camera.txt", "Pinhole 100 100 63.5 47.5 0\n128 96\nnone\n128 96\n");
  SequenceReader reader(options());
  EXPECT_EQ(reader.camera().fx, 50);
  EXPECT_EQ(reader.camera().cx, 31.5);
  EXPECT_EQ(reader.camera().width, 64);
  ASSERT_EQ(reader.warnings().size(), 1U);
  EXPECT_THAT(reader.warnings()[0],
              AllOf(HasSubstr("camera.txt"), HasSubstr("128x96"), HasSubstr("64x48")));
  writeText(root() / "camera.txt", "Pinhole 100 100 63.5 31.5 0\n128 64\nnone\n128 64\n");
  EXPECT_THROW(SequenceReader{options()}, IoError);
  EXPECT_THAT(openingComplaint(options()), AllOf(HasSubstr("camera.txt"), HasSubstr("shape")));
}

}  // namespace
}  // namespace dsorb
