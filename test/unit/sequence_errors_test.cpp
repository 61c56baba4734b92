// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/error.h"
#include "dsorb/io/sequence_reader.h"

#include "support/sequence_fixture.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdint>
#include <string>
#include <vector>

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

TEST_F(SequenceErrorsTest, FilesThatAreNoSequenceAreNamed) {
  for (const auto& [name, words] : {std::pair("notes.txt", "notes.txt: "),
                                    {"00000.png", "one image; expected a folder"},
                                    {"drive.mcap", "a ROS bag, which `dsorb run`"}}) {
    writeText(root() / name, "RIFF");
    EXPECT_THAT(openingComplaint(optionsFor(root() / name)), HasSubstr(words)) << name;
  }
}

TEST_F(SequenceErrorsTest, TruncatedImagesEndTheSequenceAfterTheFramesBefore) {
  for (const std::string suffix : {".png", ".jpg", ".pgm"}) {
    fs::remove_all(root() / "images");
    writeDso(5, suffix);
    const fs::path broken = root() / "images" / ("000003" + suffix);
    fs::resize_file(broken, fs::file_size(broken) / 2);
    testing::internal::CaptureStderr();
    for (const bool prefetch : {false, true}) {
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

std::vector<std::uint8_t> encodedJpeg(int width, int height) {
  cv::Mat image(height, width, CV_8UC1);
  cv::randu(image, 0, 256);
  std::vector<std::uint8_t> bytes;
  cv::imencode(".jpg", image, bytes);
  return bytes;
}

/// What is left of a JPEG, with an end mark that was not its own.
std::vector<std::uint8_t> cutWithEndMark() {
  std::vector<std::uint8_t> bytes = encodedJpeg(64, 48);
  bytes.resize(bytes.size() / 2);
  bytes.insert(bytes.end(), {0xFF, 0xD9});
  return bytes;
}

/// What is left of a JPEG that holds a whole small one, as those of cameras do.
std::vector<std::uint8_t> cutWithThumbnail() {
  std::vector<std::uint8_t> bytes = encodedJpeg(64, 48);
  bytes.resize(bytes.size() / 2);
  const std::vector<std::uint8_t> thumbnail = encodedJpeg(16, 12);
  const std::size_t length = thumbnail.size() + 2;
  std::vector<std::uint8_t> segment = {0xFF,
                                       0xE1,
                                       static_cast<std::uint8_t>(length >> 8U),
                                       static_cast<std::uint8_t>(length & 0xFFU)};
  segment.insert(segment.end(), thumbnail.begin(), thumbnail.end());
  bytes.insert(bytes.begin() + 2, segment.begin(), segment.end());
  return bytes;
}

TEST_F(SequenceErrorsTest, JpegFilesOfWhichAPartIsMissingAreNamed) {
  writeDso(1, ".jpg");
  for (const auto& bytes : {cutWithEndMark(), cutWithThumbnail()}) {
    writeText(root() / "images" / "000000.jpg", std::string(bytes.begin(), bytes.end()));
    SequenceReader reader(options());
    testing::internal::CaptureStderr();
    try {
      EXPECT_FALSE(reader.next());
      ADD_FAILURE() << "nothing was thrown";
    } catch (const IoError& error) {
      EXPECT_THAT(error.what(), AllOf(HasSubstr("000000.jpg"), HasSubstr("truncated or damaged")));
    }
    EXPECT_EQ(testing::internal::GetCapturedStderr(), "");
  }
}

TEST_F(SequenceErrorsTest, JpegFilesHaveTheGreyLevelsOfOpenCv) {
  writeDso(1, ".jpg");
  for (const int type : {CV_8UC1, CV_8UC3}) {
    cv::Mat image(48, 64, type);
    cv::randu(image, cv::Scalar::all(0), cv::Scalar::all(256));
    const fs::path file = root() / "images" / "000000.jpg";
    writeImage(file, image);
    const cv::Mat expected = cv::imread(file.string(), cv::IMREAD_GRAYSCALE);
    SequenceReader reader(options());
    const FramePtr frame = reader.next()->frame;
    for (int y = 0; y < expected.rows; ++y) {
      for (int x = 0; x < expected.cols; ++x) {
        ASSERT_EQ(frame->level(0).at(x, y).intensity, expected.at<std::uint8_t>(y, x));
      }
    }
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
  EXPECT_THAT(complain("0 1.0 5\n1 2.0 5\n2 3.0 1e-308\n"),
              AllOf(HasSubstr("times.txt:3"), HasSubstr("exposure 1e-308; expected 0")));
  EXPECT_THAT(complain("0 1.0\n1 1.0\n2 3.0\n"), HasSubstr("times.txt:2"));
  EXPECT_THAT(complain("0 1.0\n1 2.0\n2 3.0\n\n"), HasSubstr("nothing was thrown"));
}

TEST_F(SequenceErrorsTest, WhatHasTheNameOfAFileBesideTheImagesMustBeOne) {
  writeDso(3, ".png");
  const fs::path times = root() / "times.txt";
  fs::remove(times);
  fs::create_symlink("nowhere", times);
  EXPECT_THAT(openingComplaint(options()), HasSubstr("times.txt: cannot be opened"));
  fs::remove(times);
  fs::create_directories(times);
  EXPECT_THAT(openingComplaint(options()),
              AllOf(HasSubstr("times.txt"), HasSubstr("Is a directory")));
  fs::remove(times);
  fs::remove(root() / "camera.txt");
  fs::create_directories(root() / "camera.txt");
  EXPECT_THAT(openingComplaint(options()),
              AllOf(HasSubstr("camera.txt"), HasSubstr("Is a directory")));
  SequenceOptions named = options();
  named.calibration_file = root() / "named.txt";
  writeText(named.calibration_file, "Pinhole 50 50 31.5 23.5 0\n64 48\nnone\n64 48\n");
  EXPECT_THAT(openingComplaint(named), HasSubstr("nothing was thrown"));
}

TEST_F(SequenceErrorsTest, NanosecondsAreTakenAsSuch) {
  writeDso(3);
  writeText(root() / "times.txt",
            "0 1403636579763555584\n1 1403636579813555456\n2 1403636579863555584\n");
  const SequenceReader reader(options());
  EXPECT_NEAR(reader.timestamp(1), 1403636579.813555456, 1e-6);
  ASSERT_EQ(reader.warnings().size(), 1U);
  EXPECT_THAT(reader.warnings()[0], AllOf(HasSubstr("times.txt"), HasSubstr("nanoseconds")));
  writeText(root() / "times.txt", "0 1403636579.7\n1 1403636579.8\n2 1403636579.9\n");
  EXPECT_EQ(SequenceReader(options()).warnings().size(), 0U);
}

TEST_F(SequenceErrorsTest, ImagesWithoutTimesAreSaidToBeATenthApart) {
  writeDso(2);
  fs::remove(root() / "times.txt");
  const SequenceReader reader(options());
  EXPECT_NEAR(reader.timestamp(1), .1, 1e-9);
  ASSERT_EQ(reader.warnings().size(), 1U);
  EXPECT_THAT(reader.warnings()[0], AllOf(HasSubstr("images: no times.txt"), HasSubstr("0.1 s")));
}

TEST_F(SequenceErrorsTest, FewBitsInSixteenAreRecognisedOrDeclared) {
  writeDso(1);
  cv::Mat image(48, 64, CV_16UC1, cv::Scalar(500));
  image.at<std::uint16_t>(0, 0) = 1019;
  writeImage(root() / "images" / "000000.png", image);
  const auto level = [&](int bits, std::size_t warnings) {
    SequenceOptions o = options();
    o.bits = bits;
    SequenceReader reader(o);
    const SequenceFrame frame = *reader.next();
    EXPECT_EQ(frame.warnings.size(), warnings) << bits;
    return frame.frame->level(0).at(5, 5).intensity;
  };
  EXPECT_NEAR(level(0, 1), 255 * 500.0 / 1023, 1e-3);
  EXPECT_NEAR(level(12, 0), 255 * 500.0 / 4095, 1e-3);
  EXPECT_NEAR(level(16, 0), 255 * 500.0 / 65535, 1e-3);
  EXPECT_NEAR(level(9, 1), 255 * 500.0 / 511, 1e-3) << "a value is too large";
  image.at<std::uint16_t>(0, 0) = 60000;
  writeImage(root() / "images" / "000000.png", image);
  EXPECT_NEAR(level(0, 0), 255 * 500.0 / 65535, 1e-3);
}

TEST_F(SequenceErrorsTest, LensThatCannotBeIsRefused) {
  writeDso(1);
  const auto complain = [&](const std::string& lens, const std::string& mode) {
    writeText(root() / "camera.txt", lens + "\n64 48\n" + mode + "\n64 48\n");
    return openingComplaint(options());
  };
  for (const char* mode : {"crop", "full", "none", "1 1 0.5 0.5 0"}) {
    EXPECT_THAT(complain("Pinhole 1 1 31.5 23.5 0", mode), HasSubstr("focal lengths 1 1"));
    EXPECT_THAT(complain("EquiDistant 50 50 31.5 23.5 1e9 0 0 0", mode), HasSubstr("distortion"));
    EXPECT_THAT(complain("RadTan 40 40 31.5 23.5 5 5 5 5", mode), HasSubstr("distortion"));
  }
  EXPECT_THAT(complain("RadTan 40 40 31.5 23.5 -0.28 0.07 0 0", "crop"), HasSubstr("nothing was"));
}

TEST_F(SequenceErrorsTest, DoubtfulLensesAreReadWithAWarning) {
  writeDso(1);
  const auto warnings =
      [&](const std::string& lens, const std::string& mode, const std::string& output = "64 48") {
        writeText(root() / "camera.txt", lens + "\n64 48\n" + mode + "\n" + output + "\n");
        const SequenceReader reader(options());
        std::string all;
        for (const std::string& warning : reader.warnings()) all += warning + "\n";
        return all;
      };
  EXPECT_THAT(warnings("EquiDistant 22 22 31.5 23.5 0 0 0 0", "crop"),
              AllOf(HasSubstr("camera.txt: the crop"), HasSubstr("third line")));
  EXPECT_THAT(warnings("Pinhole 50 50 60 23.5 0", "none"), HasSubstr("principal point 60 23.5"));
  EXPECT_THAT(warnings("Pinhole 5000 5000 31.5 23.5 0", "none"), HasSubstr("0.7219 degrees only"));
  EXPECT_EQ(warnings("RadTan 40 40 31.5 23.5 -0.28 0.07 0 0", "crop"), "");
  EXPECT_EQ(warnings("FOV 0.53 0.70 0.49 0.50 0.9", "crop"), "");
  EXPECT_EQ(warnings("Pinhole 40 40 31.5 23.5 0", "crop", "48 48"), "");
  EXPECT_THAT(warnings("Pinhole 40 40 31.5 23.5 0", "crop", "64 480"),
              HasSubstr("stretches images: focal lengths 40 407.7 instead of 40 40"));
}

TEST_F(SequenceErrorsTest, BadCalibrationNamesItsFile) {
  writeDso(1);
  writeText(root() / "camera.txt", "Pinhole 50 50 31.5 nan 0\n64 48\nnone\n64 48\n");
  EXPECT_THAT(openingComplaint(options()), HasSubstr("camera.txt:1"));
  writeText(root() / "camera.txt", "Pinhole 50 50 7 7 0\n12 12\nnone\n12 12\n");
  EXPECT_THAT(openingComplaint(options()), AllOf(HasSubstr("camera.txt"), HasSubstr("12x12")));
  writeText(root() / "camera.txt", "Pinhole 50 50 31.5 23.5 0\n64 48\ncrop\n65536 65536\n");
  EXPECT_THAT(openingComplaint(options()),
              AllOf(HasSubstr("camera.txt: "), HasSubstr("65536x65536")));
}

}  // namespace
}  // namespace dsorb
