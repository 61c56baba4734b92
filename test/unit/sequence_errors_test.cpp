// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/error.h"
#include "dsorb/io/sequence_reader.h"

#include "support/sequence_fixture.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

namespace dsorb {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

class SequenceErrorsTest : public SequenceFixture {};

TEST_F(SequenceErrorsTest, CalibratedPhotometryNeedsItsFiles) {
  writeDso(1);
  SequenceOptions o = options();
  o.brightness = BrightnessModel::kCalibrated;
  EXPECT_THROW(SequenceReader{o}, ConfigError);
  EXPECT_THAT(openingComplaint(o), HasSubstr("pcalib.txt"));
}

TEST_F(SequenceErrorsTest, MissingAndEmptyFoldersAreRefused) {
  EXPECT_THAT(openingComplaint(optionsFor(root() / "nothing")), HasSubstr("no such file"));
  EXPECT_THAT(openingComplaint(options()), HasSubstr("no data set; expected"));
  fs::create_directories(root() / "images");
  EXPECT_THAT(openingComplaint(options()), HasSubstr("holds no images"));
  writeText(root() / "images.zip", "this is no archive");
  EXPECT_THAT(openingComplaint(optionsFor(root() / "images.zip")), HasSubstr("zip archive"));
  EXPECT_THROW(SequenceReader{options()}, IoError);
}

TEST_F(SequenceErrorsTest, TruncatedImagesEndTheSequenceAfterTheFramesBefore) {
  for (const std::string suffix : {".png", ".jpg", ".pgm"}) {
    fs::remove_all(root() / "images");
    writeDso(5, suffix);
    const fs::path broken = root() / "images" / ("000003" + suffix);
    fs::resize_file(broken, fs::file_size(broken) / 2);
    testing::internal::CaptureStderr();
    for (const int prefetch : {0, 2}) {
      SequenceOptions o = options();
      o.prefetch = prefetch;
      SequenceReader reader(o);
      for (int i = 0; i < 3; ++i) EXPECT_EQ(reader.next()->index, i);
      try {
        EXPECT_FALSE(reader.next()) << suffix;
        ADD_FAILURE() << suffix << ": nothing was thrown";
      } catch (const IoError& error) {
        EXPECT_THAT(error.what(), HasSubstr("000003" + suffix));
      }
      EXPECT_FALSE(reader.next().has_value());
    }
    EXPECT_EQ(testing::internal::GetCapturedStderr(), "") << suffix;  // the library is silent
  }
}

TEST_F(SequenceErrorsTest, FilesThatAreNoImagesAreNamed) {
  writeDso(1);
  for (const std::string content : {"", "no image at all", "P5 64 48 255\n", "\x89PNG\r\n\x1a\n"}) {
    writeText(root() / "images" / "000000.png", content);
    SequenceReader reader(options());
    EXPECT_THROW((void)reader.next(), IoError) << content;
  }
}

TEST_F(SequenceErrorsTest, ImageOfAnotherSizeIsNamed) {
  writeDso(3);
  writeImage(root() / "images" / "000001.png", cv::Mat(48, 62, CV_8U, cv::Scalar(1)));
  SequenceReader reader(options());
  EXPECT_TRUE(reader.next().has_value());
  try {
    EXPECT_FALSE(reader.next());
    ADD_FAILURE() << "nothing was thrown";
  } catch (const IoError& error) {
    EXPECT_THAT(error.what(),
                AllOf(HasSubstr("000001.png"), HasSubstr("62x48"), HasSubstr("64x48")));
  }
}

TEST_F(SequenceErrorsTest, TimesThatDoNotFitAreRefused) {
  writeDso(3);
  const auto complain = [&](const std::string& times) {
    writeText(root() / "times.txt", times);
    return openingComplaint(options());
  };
  EXPECT_THAT(complain("0 1.0\n1 2.0\n"),
              AllOf(HasSubstr("times.txt"), HasSubstr("2 times for 3")));
  EXPECT_THAT(complain("0 1.0\n1 soon\n2 3.0\n"),
              AllOf(HasSubstr("times.txt:2"), HasSubstr("'soon'")));
  EXPECT_THAT(complain("0 1.0\n1\n2 3.0\n"), HasSubstr("times.txt:2"));
  EXPECT_THAT(complain("0 1.0\n1 nan\n2 3.0\n"), HasSubstr("times.txt:2"));
  EXPECT_THAT(complain("0 1.0 5\n1 2.0 -5\n2 3.0 5\n"), HasSubstr("times.txt:2"));
  EXPECT_THAT(complain("0 1.0\n1 1.0\n2 3.0\n"), HasSubstr("times.txt:2"));
  EXPECT_THAT(complain("0 1.0\n1 2.0\n2 3.0\n\n"), HasSubstr("nothing was thrown"));
}

TEST_F(SequenceErrorsTest, BadCalibrationNamesItsFile) {
  writeDso(1);
  writeText(root() / "camera.txt", "Pinhole 50 50 31.5 nan 0\n64 48\nnone\n64 48\n");
  EXPECT_THAT(openingComplaint(options()), HasSubstr("camera.txt:1"));
  writeText(root() / "camera.txt", "Pinhole 50 50 7 7 0\n12 12\nnone\n12 12\n");
  EXPECT_THAT(openingComplaint(options()), AllOf(HasSubstr("camera.txt"), HasSubstr("12x12")));
}

}  // namespace
}  // namespace dsorb
