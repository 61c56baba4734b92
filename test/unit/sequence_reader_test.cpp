// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/io/sequence_reader.h"

#include "dsorb/error.h"

#include "support/real_data.h"
#include "support/sequence_fixture.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

namespace dsorb {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

float levelOf(const SequenceFrame& frame) {
  return frame.frame->level(0).at(20, 20).intensity;
}

class SequenceReaderTest : public SequenceFixture {};

TEST_F(SequenceReaderTest, DsoFolderWithoutTimes) {
  writeDso(3);
  SequenceReader reader(options());
  EXPECT_EQ(reader.format(), SequenceFormat::kDso);
  EXPECT_EQ(reader.brightness(), BrightnessModel::kUncalibrated);
  EXPECT_EQ(reader.size(), 3);
  EXPECT_EQ(reader.camera().width, 64);
  EXPECT_EQ(reader.camera().fx, 50);
  const auto frames = readAll(reader);
  ASSERT_EQ(frames.size(), 3U);
  for (int i = 0; i < 3; ++i) {
    const SequenceFrame& frame = frames[static_cast<std::size_t>(i)];
    EXPECT_EQ(frame.index, i);
    EXPECT_EQ(frame.frame->id().value, i);
    EXPECT_DOUBLE_EQ(frame.frame->timestamp(), 0.1 * i);
    EXPECT_DOUBLE_EQ(reader.timestamp(i), 0.1 * i);
    EXPECT_EQ(frame.frame->exposure(), 1);
    EXPECT_EQ(frame.frame->responseSlope(), nullptr);
    EXPECT_EQ(levelOf(frame), 10.0F * static_cast<float>(i));
    EXPECT_EQ(frame.image_file, (root() / "images" / ("00000" + std::to_string(i) + ".png")));
    EXPECT_GT(frame.read_milliseconds, 0);
    EXPECT_GT(frame.pyramid_milliseconds, 0);
  }
  EXPECT_FALSE(reader.next().has_value());
}

TEST_F(SequenceReaderTest, ImagesMayLieInAnArchiveAndBeNamedDirectly) {
  writeDso(3);
  writeText(root() / "times.txt", "0 5.0\n1 5.5\n2 6.0\n");
  zipFolder(root() / "images", root() / "images.zip");
  fs::copy_file(root() / "images.zip", root() / "CAMERA.ZIP");
  for (const std::string part : {"", "images", "images/", "images.zip", "CAMERA.ZIP"}) {
    SequenceReader reader(optionsFor(root() / part));
    EXPECT_EQ(reader.format(), SequenceFormat::kDso) << part;
    const auto frames = readAll(reader);
    ASSERT_EQ(frames.size(), 3U) << part;
    EXPECT_EQ(levelOf(frames[2]), 20) << part;
    EXPECT_EQ(frames[2].frame->timestamp(), 6) << part;
  }
  fs::remove_all(root() / "images");
  EXPECT_THAT(indicesOf(options()), ElementsAre(0, 1, 2));
}

TEST_F(SequenceReaderTest, ImagesComeInTheOrderOfTheirNumbers) {
  const std::vector<std::string> names = {"1.25.png",
                                          "1.5.png",
                                          "2.png",
                                          "10.png",
                                          "a007.png",
                                          "a7.png",
                                          "a8.png",
                                          "b1_9.png",
                                          "b1_10.png"};
  writeDso(static_cast<int>(names.size()));
  for (std::size_t i = 0; i < names.size(); ++i) {
    fs::rename(root() / "images" / ("00000" + std::to_string(i) + ".png"),
               root() / "images" / names[i]);
  }
  zipFolder(root() / "images", root() / "zipped.zip");
  for (const std::string images : {"images", "zipped.zip"}) {
    SequenceOptions numbered = optionsFor(root() / images);
    numbered.calibration_file = root() / "camera.txt";
    SequenceReader reader(numbered);
    for (const std::string& name : names) {
      EXPECT_THAT(reader.next()->image_file, testing::EndsWith(name)) << images;
    }
  }
}

TEST_F(SequenceReaderTest, StartEndAndReverseSelectImages) {
  writeDso(6);
  SequenceOptions o = options();
  o.start = 2;
  EXPECT_THAT(indicesOf(o), ElementsAre(2, 3, 4, 5));
  o.end = 4;
  EXPECT_THAT(indicesOf(o), ElementsAre(2, 3));
  o.reverse = true;
  EXPECT_THAT(indicesOf(o), ElementsAre(3, 2));
  o.end = 100000;
  o.prefetch = false;
  EXPECT_THAT(indicesOf(o), ElementsAre(5, 4, 3, 2));
  o.start = 6;
  EXPECT_THROW(SequenceReader{o}, ConfigError);
  o.start = 2;
  o.end = 2;
  EXPECT_THROW(SequenceReader{o}, ConfigError);
}

TEST_F(SequenceReaderTest, SkippedImagesAreLeftOut) {
  writeDso(9);
  for (const bool prefetch : {false, true}) {
    SequenceOptions o = options();
    o.prefetch = prefetch;
    SequenceReader reader(o);
    EXPECT_EQ(reader.next()->index, 0);
    reader.skip(4);
    EXPECT_EQ(reader.next()->index, 5) << prefetch;
    EXPECT_EQ(reader.next()->index, 6) << prefetch;
    reader.skip(0);
    reader.skip(1);
    EXPECT_EQ(reader.next()->index, 8) << prefetch;
    EXPECT_FALSE(reader.next().has_value());
    reader.skip(3);
    EXPECT_FALSE(reader.next().has_value());
  }
}

TEST_F(SequenceReaderTest, AllImagesMayBeSkipped) {
  writeDso(3);
  SequenceReader reader(options());
  reader.skip(100);
  EXPECT_FALSE(reader.next().has_value());
}

TEST_F(SequenceReaderTest, IndicesAreKnownBeforehand) {
  writeDso(5);
  SequenceOptions o = options();
  o.start = 2;
  o.reverse = true;
  const SequenceReader reader(o);
  EXPECT_EQ(reader.index(0), 4);
  EXPECT_EQ(reader.index(2), 2);
  EXPECT_THROW((void)reader.index(3), std::out_of_range);
}

TEST_F(SequenceReaderTest, EveryImageKindIsRead) {
  for (const std::string suffix : {".png", ".jpg", ".pgm", ".PNG"}) {
    fs::remove_all(root() / "images");
    writeDso(3, suffix);
    SequenceReader reader(options());
    const auto frames = readAll(reader);
    ASSERT_EQ(frames.size(), 3U) << suffix;
    EXPECT_NEAR(levelOf(frames[2]), 20, suffix == ".jpg" ? 1 : 0) << suffix;
  }
}

TEST_F(SequenceReaderTest, ColourAndSixteenBitsBecomeGreyLevels) {
  writeDso(1);
  const fs::path file = root() / "images" / "000000.png";
  const auto read = [&] {
    SequenceReader reader(options());
    return levelOf(*reader.next());
  };
  writeImage(file, cv::Mat(48, 64, CV_8UC3, cv::Scalar(0, 0, 200)));
  EXPECT_NEAR(read(), 0.299 * 200, 1);  // red's share of luma; libpng rounds down
  writeImage(file, cv::Mat(48, 64, CV_16UC1, cv::Scalar(12345)));
  EXPECT_FLOAT_EQ(read(), 12345.0F / 257.0F);
  writeImage(file, cv::Mat(48, 64, CV_16UC3, cv::Scalar(12345, 12345, 12345)));
  EXPECT_NEAR(read(), 12345.0 / 257.0, 1e-2);
  writeImage(file, cv::Mat(48, 64, CV_8UC4, cv::Scalar(77, 77, 77, 9)));
  EXPECT_FLOAT_EQ(read(), 77);
}

TEST_F(SequenceReaderTest, ForeignFilesBetweenImagesAreIgnored) {
  writeDso(2);
  writeText(root() / "images" / "Thumbs.db", "x");
  writeText(root() / "images" / "000000.txt", "x");
  writeText(root() / "images" / ".000001.png", "x");
  writeText(root() / "images" / "readme", "x");
  fs::create_directories(root() / "images" / "0000005.png");
  EXPECT_THAT(indicesOf(options()), ElementsAre(0, 1));
  zipFolder(root() / "images", root() / "images.zip");
  EXPECT_THAT(indicesOf(optionsFor(root() / "images.zip")), ElementsAre(0, 1));
}

TEST_F(SequenceReaderTest, ImagesWithoutANumberAreNoneOfANumberedSequence) {
  const auto write = [&](const std::string& name) {
    writeImage(root() / "images" / name, cv::Mat(48, 64, CV_8U, cv::Scalar(10)));
  };
  writeDso(0);
  for (const char* name : {"response.png", "mask.png"}) write(name);
  EXPECT_THAT(indicesOf(options()), ElementsAre(0, 1));  // names without any number are images
  for (const char* name : {"shot.png", "shot 2.png", "shot 3.png"}) write(name);
  zipFolder(root() / "images", root() / "zipped.zip");
  for (const char* images : {"images", "zipped.zip"}) {
    SCOPED_TRACE(images);
    SequenceReader reader(optionsFor(root() / images));
    EXPECT_EQ(reader.size(), 3);
    EXPECT_THAT(reader.warnings(),
                testing::Contains(HasSubstr("mask.png: not taken for an image")));
    EXPECT_THAT(readAll(reader)[0].image_file, HasSubstr("shot.png"));
  }
}

TEST_F(SequenceReaderTest, WhatAnArchiveHoldsBesideImagesIsNamed) {
  writeDso(2);
  writeText(root() / "images/times.txt", "0 1\n1 2\n");
  zipFolder(root() / "images", root() / "images.zip");
  SequenceReader reader(optionsFor(root() / "images.zip"));
  EXPECT_THAT(reader.warnings(),
              testing::Contains(HasSubstr("images.zip/times.txt: not read inside of an archive")));
}

TEST_F(SequenceReaderTest, CalibratedPhotometryUsesResponseVignetteAndExposure) {
  writeDso(3);
  writeText(root() / "times.txt", "0 1.0 10\n1 2.0 0\n2 3.0 20\n");
  std::string response;
  for (int i = 0; i < 256; ++i) response += std::to_string(i * i) + " ";
  writeText(root() / "pcalib.txt", response);
  cv::Mat vignette(48, 64, CV_8U, cv::Scalar(200));
  vignette.at<std::uint8_t>(20, 20) = 100;
  vignette.at<std::uint8_t>(30, 30) = 0;
  writeImage(root() / "vignette.png", vignette);
  SequenceReader reader(options());
  EXPECT_EQ(reader.brightness(), BrightnessModel::kCalibrated);
  const auto frames = readAll(reader);
  EXPECT_NEAR(levelOf(frames[2]), 2 * 20.0 * 20.0 / 255, 1e-3);
  EXPECT_TRUE(std::isnan(frames[2].frame->level(0).at(30, 30).intensity));
  EXPECT_DOUBLE_EQ(frames[0].frame->exposure(), 0.010);
  EXPECT_DOUBLE_EQ(frames[1].frame->exposure(), 0.015);  // mean of its neighbours
  ASSERT_NE(frames[0].frame->responseSlope(), nullptr);
  EXPECT_GT((*frames[0].frame->responseSlope())[20], (*frames[0].frame->responseSlope())[200]);

  for (const auto mode : {BrightnessModel::kUncalibrated, BrightnessModel::kPerfect}) {
    SequenceOptions o = options();
    o.brightness = mode;
    SequenceReader raw(o);
    EXPECT_EQ(raw.brightness(), mode);
    const auto raw_frames = readAll(raw);
    EXPECT_EQ(levelOf(raw_frames[2]), 20);
    // Without a response it is a guess, and perfect images need none.
    EXPECT_EQ(raw_frames[2].frame->exposure(), mode == BrightnessModel::kPerfect ? 1 : 0.020);
  }
}

TEST_F(SequenceReaderTest, ExposuresThatStayUnknownAreDropped) {
  writeDso(3);
  writeText(root() / "times.txt", "0 1.0 0\n1 2.0 0\n2 3.0 20\n");
  std::string response;
  for (int i = 0; i < 256; ++i) response += std::to_string(i) + " ";
  SequenceOptions o = options();
  writeText(root() / "my_response.txt", response);
  writeImage(root() / "my_vignette.png", cv::Mat(48, 64, CV_8U, cv::Scalar(200)));
  o.response_file = (root() / "my_response.txt").string();
  SequenceReader alone(o);
  EXPECT_EQ(alone.brightness(), BrightnessModel::kUncalibrated);
  EXPECT_THAT(alone.warnings(),
              ElementsAre(AllOf(HasSubstr("my_response.txt: not used"), HasSubstr("vignette"))));
  o.brightness = BrightnessModel::kCalibrated;
  EXPECT_THROW(SequenceReader{o}, ConfigError);
  o.brightness.reset();
  o.response_file = (root() / "none.txt").string();
  EXPECT_THAT(openingComplaint(o), HasSubstr("none.txt: cannot be read"));
  o.response_file = (root() / "my_response.txt").string();
  o.vignette_file = (root() / "my_vignette.png").string();
  SequenceReader reader(o);
  EXPECT_EQ(reader.brightness(), BrightnessModel::kCalibrated);
  for (const auto& frame : readAll(reader)) EXPECT_EQ(frame.frame->exposure(), 1);
  writeImage(root() / "my_vignette.png", cv::Mat(48, 60, CV_8U, cv::Scalar(200)));
  EXPECT_THAT(openingComplaint(o), AllOf(HasSubstr("60x48"), HasSubstr("64x48")));
}

TEST_F(SequenceReaderTest, KittiOdometry) {
  writeGreyImages(root() / "image_2", 3, ".png");
  writeText(root() / "calib.txt",
            "P0: 700 0 30 0 0 700 20 0 0 0 1 0\nP2: 710 0 31 0 0 711 21 0 0 0 1 0\n");
  writeText(root() / "times.txt", "0.0e+00\n1.5e-01\n2.5e-01\n");
  SequenceReader reader(options());
  EXPECT_EQ(reader.format(), SequenceFormat::kKitti);
  EXPECT_EQ(reader.camera().fx, 710);
  EXPECT_EQ(reader.camera().cy, 21);
  EXPECT_EQ(readAll(reader)[1].frame->timestamp(), 0.15);

  // image_0 goes first where both are there; a folder can be named directly.
  writeGreyImages(root() / "image_0", 2, ".png");
  EXPECT_EQ(SequenceReader(options()).camera().fx, 700);
  EXPECT_EQ(SequenceReader(optionsFor(root() / "image_2")).camera().fx, 710);

  // Part of a sequence: the name of an image is the number of its time.
  fs::remove(root() / "image_0" / "000000.png");
  EXPECT_EQ(SequenceReader(options()).timestamp(0), 0.15);
  writeGreyImages(root() / "image_0", 4, ".png");
  EXPECT_THAT(openingComplaint(options()),
              AllOf(HasSubstr("times.txt"), HasSubstr("3 times"), HasSubstr("000003.png")));
}

TEST_F(SequenceReaderTest, EurocWithAndWithoutItsCalibration) {
  const fs::path camera = root() / "mav0" / "cam0";
  writeGreyImages(camera / "data", 3, ".png");
  writeText(camera / "data.csv",
            "#timestamp [ns],filename\r\n1403715285262142976,000000.png\r\n"
            "1403715285312143104,000002.png\r\n");
  SequenceOptions o = options();
  EXPECT_GT(SequenceReader(o).lens().focal_sigma, 0) << "no calibration: a guess";
  writeText(root() / "mine.txt", "EquiDistant 50 50 31 23 0 0 0 0\n64 48\ncrop\n48 32\n");
  o.calibration_file = (root() / "mine.txt").string();
  EXPECT_EQ(SequenceReader(o).camera().width, 48);
  writeText(camera / "sensor.yaml",
            "resolution: [64, 48]\ncamera_model: pinhole\nintrinsics: [50, 50, 31, 23]\n"
            "distortion_model: radial-tangential\ndistortion_coefficients: [-0.2, 0, 0, 0]\n");
  for (const fs::path& path : {root(), root() / "mav0", camera}) {
    SequenceReader reader(optionsFor(path));
    EXPECT_EQ(reader.format(), SequenceFormat::kEuroc);
    EXPECT_EQ(reader.camera().width, 64);
    EXPECT_LT(reader.camera().fx, 50);  // cropped: the barrel's sides come in
    const auto frames = readAll(reader);
    ASSERT_EQ(frames.size(), 2U);
    EXPECT_EQ(frames[1].frame->timestamp(), 1403715285.312143104);
    EXPECT_EQ(levelOf(frames[1]), 20);
  }
  std::string response;
  for (int i = 0; i < 256; ++i) response += std::to_string(i) + " ";
  writeText(camera / "pcalib.txt", response);
  writeImage(camera / "vignette.png", cv::Mat(48, 64, CV_8U, cv::Scalar(200)));
  EXPECT_EQ(SequenceReader(optionsFor(root())).brightness(), BrightnessModel::kCalibrated);
}

TEST_F(SequenceReaderTest, TumRgbd) {
  writeGreyImages(root() / "rgb", 2, ".png");
  writeText(root() / "rgb.txt",
            "# color images\n1305031102.175304 rgb/000000.png\n1305031102.211214 rgb/000001.png\n");
  writeText(root() / "camera.txt", "Pinhole 50 50 31 23 0\n64 48\nnone\n");
  SequenceReader reader(options());
  EXPECT_EQ(reader.format(), SequenceFormat::kTum);
  const auto frames = readAll(reader);
  ASSERT_EQ(frames.size(), 2U);
  EXPECT_EQ(frames[1].frame->timestamp(), 1305031102.211214);
  writeText(root() / "rgb.txt", "1305031102.175304\n");
  EXPECT_THAT(openingComplaint(options()), HasSubstr("rgb.txt:1"));
}

TEST_F(SequenceReaderTest, WhatAPassWithAGuessDecodedIsNotDecodedAgain) {
  const fs::path folder = root() / "holiday";
  writeGreyImages(folder, 3, ".pgm");
  SequenceOptions o = optionsFor(folder);
  o.keep_decoded = true;
  SequenceReader pass(o);
  EXPECT_EQ(readAll(pass).size(), 3U);
  writeText(folder / "000002.pgm", "no image");
  o.lens = pass.lens();
  SequenceReader second(o, std::move(pass));
  EXPECT_EQ(readAll(second).size(), 3U);
  o.keep_decoded = false;
  SequenceReader again(o, std::move(second));
  const auto frames = readAll(again);
  ASSERT_EQ(frames.size(), 3U);
  EXPECT_EQ(levelOf(frames[2]), 20);
}

TEST_F(SequenceReaderTest, PlainFolderWithACalibration) {
  writeGreyImages(root() / "holiday", 2, ".pgm");
  SequenceOptions o = optionsFor(root() / "holiday");
  EXPECT_GT(SequenceReader(o).lens().focal_sigma, 0) << "no calibration: a guess";
  writeText(root() / "phone.txt", "Pinhole 50 50 31 23 0\n64 48\n");
  o.calibration_file = (root() / "phone.txt").string();
  EXPECT_EQ(SequenceReader(o).format(), SequenceFormat::kImages);
  EXPECT_THAT(indicesOf(o), ElementsAre(0, 1));
}

TEST_F(SequenceReaderTest, FormatCanBeForced) {
  writeDso(2);
  SequenceOptions o = options();
  o.format = SequenceFormat::kDso;
  EXPECT_THAT(indicesOf(o), ElementsAre(0, 1));
  o.format = SequenceFormat::kEuroc;
  EXPECT_THAT(openingComplaint(o), AllOf(HasSubstr("mav0/cam0"), Not(HasSubstr("KITTI"))));
}

TEST_F(SequenceReaderTest, ReadingAheadGivesTheSameFramesAndStopsAtAnyTime) {
  writeDso(12);
  for (const bool prefetch : {false, true}) {
    SequenceOptions o = options();
    o.prefetch = prefetch;
    SequenceReader reader(o);
    const auto frames = readAll(reader);
    ASSERT_EQ(frames.size(), 12U);
    EXPECT_EQ(levelOf(frames[11]), 110);
    for (int taken = 0; taken < 4; ++taken) {
      SequenceReader abandoned(o);
      for (int i = 0; i < taken; ++i) EXPECT_TRUE(abandoned.next().has_value());
      SequenceReader moved = std::move(abandoned);
      EXPECT_EQ(moved.next()->index, taken);
    }
  }
}

struct RealSequence {
  const char* path;
  SequenceFormat format;
  int size, width, height;
};

class RealSequenceTest : public testing::TestWithParam<RealSequence> {};

TEST_P(RealSequenceTest, IsRecognisedAndRead) {
  const RealSequence& expected = GetParam();
  SequenceOptions options;
  options.path = realData(expected.path).string();
  if (!fs::exists(options.path)) GTEST_SKIP() << "no real data; set DSORB_DATA";
  options.end = 5;
  SequenceReader reader(options);
  EXPECT_EQ(reader.format(), expected.format);
  EXPECT_EQ(reader.size(), expected.size);
  EXPECT_EQ(reader.camera().width, expected.width);
  EXPECT_EQ(reader.camera().height, expected.height);
  const auto frames = readAll(reader);
  ASSERT_EQ(frames.size(), 5U);
  for (const SequenceFrame& frame : frames) {
    int invalid = 0;
    const PyramidLevel& level = frame.frame->level(0);
    for (int i = 0; i < level.width() * level.height(); ++i) {
      if (!std::isfinite(level.data()[i])) ++invalid;
    }
    EXPECT_EQ(invalid, 0);
    EXPECT_GE(frame.frame->pyramid().levels(), 4);
  }
}

INSTANTIATE_TEST_SUITE_P(
    Sequences,
    RealSequenceTest,
    testing::Values(
        RealSequence{"kitti_odometry/sequences/00", SequenceFormat::kKitti, 200, 1232, 368},
        RealSequence{"kitti_odometry/sequences/06", SequenceFormat::kKitti, 51, 1216, 368},
        RealSequence{"euroc/V1_01_easy_flight", SequenceFormat::kEuroc, 90, 752, 480},
        RealSequence{"tum_rgbd/freiburg1_rpy_part", SequenceFormat::kTum, 60, 640, 480},
        RealSequence{"7scenes_redkitchen", SequenceFormat::kDso, 200, 640, 480},
        RealSequence{"tartanair_hospital", SequenceFormat::kDso, 90, 640, 480},
        RealSequence{"room_hand", SequenceFormat::kDso, 90, 640, 480}));

}  // namespace
}  // namespace dsorb
