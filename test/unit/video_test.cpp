// SPDX-License-Identifier: BSD-3-Clause
// Videos and cameras behind SequenceReader; a file played in its own time stands for a camera.
#include "dsorb/error.h"
#include "dsorb/io/sequence_reader.h"

#include "support/sequence_fixture.h"
#include "support/sound_files.h"
#include "support/text_files.h"
#include "support/video_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <cstdint>
#include <string>
#include <thread>
#include <vector>

namespace dsorb {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

constexpr int kImages = 30;
constexpr double kRate = 30;  // [1/s]

class VideoTest : public SequenceFixture {
 protected:
  /// 64 x 48 pixels of grey level 50 + 5 * index.
  static cv::Mat grey(int index) {
    return cv::Mat(48, 64, CV_8UC3, cv::Scalar::all(50 + 5 * index));
  }
  fs::path video(const std::string& name = "clip.avi", const std::string& codec = "MJPG") {
    const fs::path file = root() / name;
    if (!writeVideo(file, codec, kRate, kImages, grey)) ADD_FAILURE() << "no encoder " << codec;
    return file;
  }
  static SequenceOptions viewOf(const fs::path& file) {
    SequenceOptions options = optionsFor(file);
    options.horizontal_view = 60;
    return options;
  }
  static float levelOf(const SequenceFrame& frame) {
    return frame.frame->level(0).at(20, 20).intensity;
  }
};

TEST_F(VideoTest, ImagesAndTimesAreThoseOfTheContainer) {
  const struct {
    const char* name;
    const char* codec;
  } kinds[] = {{"a.avi", "MJPG"}, {"a.mkv", "MJPG"}, {"a.mp4", "avc1"}, {"a.mov", "mp4v"}};
  for (const auto& kind : kinds) {
    SCOPED_TRACE(kind.name);
    SequenceReader reader(viewOf(video(kind.name, kind.codec)));
    EXPECT_EQ(reader.format(), SequenceFormat::kVideo);
    EXPECT_EQ(reader.size(), kImages);
    EXPECT_EQ(reader.camera().width, 64);
    const auto frames = readAll(reader);
    ASSERT_EQ(frames.size(), static_cast<std::size_t>(kImages));
    for (int i = 0; i < kImages; ++i) {
      const SequenceFrame& frame = frames[static_cast<std::size_t>(i)];
      EXPECT_EQ(frame.index, i);
      EXPECT_NEAR(frame.frame->timestamp(), i / kRate, 0.0006);  // MKV has milliseconds
      EXPECT_NEAR(levelOf(frame), 50 + 5 * i, 3);                // measured: 2, of the codecs
      EXPECT_TRUE(frame.warnings.empty());
    }
  }
}

TEST_F(VideoTest, ImagesOfAnyWidthAreWholeAndStayInTheirMemory) {
  for (const int width : {1240, 364, 90}) {  // FFmpeg writes 16 pixels at a time
    SCOPED_TRACE(width);
    const fs::path file = root() / (std::to_string(width) + ".mp4");
    ASSERT_TRUE(writeVideo(file, "mp4v", kRate, 3, [&](int) {
      cv::Mat image(60, width, CV_8UC3, cv::Scalar::all(40));
      image.colRange(width - 32, width).setTo(cv::Scalar::all(200));
      return image;
    }));
    SequenceReader reader(viewOf(file));
    const auto frame = reader.next();
    ASSERT_TRUE(frame);
    const int last = reader.camera().width - 1;
    EXPECT_NEAR(frame->frame->level(0).at(last, 30).intensity, 200, 5);
    EXPECT_NEAR(frame->frame->level(0).at(last - 60, 30).intensity, 40, 5);
  }
}

TEST_F(VideoTest, PartsAreSelected) {
  SequenceOptions o = viewOf(video());
  o.from = 0.2;
  o.to = 0.5;
  o.every = 3;
  EXPECT_THAT(indicesOf(o), ElementsAre(6, 9, 12, 15));
  o = viewOf(root() / "clip.avi");
  o.start = 26;
  EXPECT_THAT(indicesOf(o), ElementsAre(26, 27, 28, 29));
  o.start = 3;
  o.end = 5;
  EXPECT_THAT(indicesOf(o), ElementsAre(3, 4));
  o.end = -1;
  o.start = 30;
  EXPECT_THROW(SequenceReader{o}, ConfigError);
  EXPECT_THAT(openingComplaint(o), HasSubstr("no image is selected"));
  o = viewOf(root() / "clip.avi");
  o.from = 1.5;
  EXPECT_THAT(openingComplaint(o), HasSubstr("no image is selected"));
  o = viewOf(root() / "clip.avi");
  o.reverse = true;
  EXPECT_THAT(openingComplaint(o), HasSubstr("forwards only"));
}

TEST_F(VideoTest, SkippedImagesAreLeftOut) {
  for (const bool prefetch : {false, true}) {
    SequenceOptions o = viewOf(video());
    o.prefetch = prefetch;
    SequenceReader reader(o);
    EXPECT_EQ(reader.next()->index, 0);
    reader.skip(20);
    const auto frame = reader.next();
    EXPECT_EQ(frame->index, 21);
    EXPECT_NEAR(levelOf(*frame), 155, 3);
  }
}

/// Turns the picture of an MP4 by its transformation matrix, as phones do.
void turnClockwise(const fs::path& file) {
  std::string bytes = readText(file);
  const std::string unity(
      "\x00\x01\x00\x00\x00\x00\x00\x00\x00\x00\x00\x00"
      "\x00\x00\x00\x00\x00\x01\x00\x00",
      20);
  const std::string turned(
      "\x00\x00\x00\x00\x00\x01\x00\x00\x00\x00\x00\x00"
      "\xFF\xFF\x00\x00\x00\x00\x00\x00",
      20);
  const std::size_t header = bytes.find("tkhd");
  ASSERT_NE(header, std::string::npos);
  const std::size_t matrix = bytes.find(unity, header);
  ASSERT_NE(matrix, std::string::npos);
  writeText(file, bytes.replace(matrix, unity.size(), turned));
}

TEST_F(VideoTest, PortraitVideosAreUpright) {
  const fs::path file = root() / "phone.mp4";
  ASSERT_TRUE(writeVideo(file, "mp4v", kRate, 3, [](int) {
    cv::Mat image(64, 96, CV_8UC3, cv::Scalar::all(40));
    image.colRange(0, 48).setTo(cv::Scalar::all(200));  // left: the top once it is upright
    return image;
  }));
  turnClockwise(file);
  SequenceReader reader(viewOf(file));
  EXPECT_EQ(reader.camera().width, 64);
  EXPECT_EQ(reader.camera().height, 96);
  const auto frame = reader.next();
  EXPECT_NEAR(frame->frame->level(0).at(32, 10).intensity, 200, 5);
  EXPECT_NEAR(frame->frame->level(0).at(32, 85).intensity, 40, 5);
}

TEST_F(VideoTest, TheSensorsRowsAreColumnsOfAPortraitVideo) {
  const fs::path file = root() / "phone.mp4";
  ASSERT_TRUE(writeVideo(
      file, "mp4v", kRate, 1, [](int) { return cv::Mat(64, 96, CV_8UC3, cv::Scalar::all(40)); }));
  SequenceOptions options = viewOf(file);
  options.readout = Readout{0.025, 0};
  EXPECT_FALSE(SequenceReader(options).lens().columns);
  turnClockwise(file);
  const Lens lens = SequenceReader(options).lens();
  EXPECT_TRUE(lens.columns);
  EXPECT_TRUE(lens.backwards) << "the sensor's upper row is on the right";
  EXPECT_EQ(lens.readout.seconds, 0.025);
  options.horizontal_view = 0;
  options.calibration_file = root() / "camera.txt";
  writeText(options.calibration_file, "Pinhole 60 60 31.5 47.5 0\n64 96\nreadout 20\n");
  const Lens calibrated = SequenceReader(options).lens();
  EXPECT_FALSE(calibrated.columns) << "the calibration is that of the upright images";
  EXPECT_EQ(calibrated.readout.seconds, 0.025);
}

TEST_F(VideoTest, TheSensorsCalibrationTurnsWithTheImages) {
  const fs::path file = root() / "phone.mp4";
  ASSERT_TRUE(writeVideo(
      file, "mp4v", kRate, 1, [](int) { return cv::Mat(64, 96, CV_8UC3, cv::Scalar::all(40)); }));
  turnClockwise(file);
  SequenceOptions options = optionsFor(file);
  options.calibration_file = root() / "camera.txt";
  writeText(options.calibration_file,
            "Pinhole 60 61 40.5 30.5 0\n96 64\nnone\n96 64\nreadout 20\n");
  const SequenceReader reader(options);
  EXPECT_EQ(reader.camera().fx, 61);
  EXPECT_EQ(reader.camera().cx, 32.5);
  EXPECT_EQ(reader.camera().cy, 40.5);
  EXPECT_TRUE(reader.lens().columns && reader.lens().backwards);
  EXPECT_THAT(reader.warnings(), testing::Contains(HasSubstr("turned by 90 degrees")));
}

/// Moves the images of an MKV with JPEGs from a position on to later times.
void delay(const fs::path& file, int from, int milliseconds) {
  std::string bytes = readText(file);
  const std::string begin("\x80\xFF\xD8\xFF", 4);  // of an image; its time stands before
  int index = 0;
  for (std::size_t at = bytes.find(begin); at != std::string::npos;
       at = bytes.find(begin, at + 1)) {
    if (index++ < from) continue;
    const auto high = static_cast<unsigned char>(bytes[at - 2]);
    const auto low = static_cast<unsigned char>(bytes[at - 1]);
    const int later = 256 * high + low + milliseconds;
    bytes[at - 2] = static_cast<char>(later / 256);
    bytes[at - 1] = static_cast<char>(later % 256);
  }
  ASSERT_EQ(index, kImages);
  writeText(file, bytes);
}

TEST_F(VideoTest, AVaryingRateIsToldAndItsTimesAreUsed) {
  const fs::path file = video("clip.mkv");
  delay(file, 20, 3000);
  SequenceReader reader(viewOf(file));
  const auto frames = readAll(reader);
  ASSERT_EQ(frames.size(), static_cast<std::size_t>(kImages));
  EXPECT_NEAR(frames[19].frame->timestamp(), 19 / kRate, 0.0006);
  EXPECT_NEAR(frames[20].frame->timestamp(), 3 + 20 / kRate, 0.0006);
  EXPECT_NEAR(frames[29].frame->timestamp(), 3 + 29 / kRate, 0.0006);
  ASSERT_EQ(frames[20].warnings.size(), 1U);
  EXPECT_THAT(frames[20].warnings[0], AllOf(HasSubstr("image 20"), HasSubstr("rate varies")));
  EXPECT_TRUE(frames[29].warnings.empty()) << "told once";

  SequenceOptions later = viewOf(file);
  later.start = 25;
  SequenceReader from_there(later);
  const auto rest = readAll(from_there);
  ASSERT_EQ(rest.size(), 5U);
  ASSERT_EQ(rest[0].warnings.size(), 1U) << "of an image that was skipped";
  EXPECT_TRUE(rest[1].warnings.empty());
}

TEST_F(VideoTest, FilesThatAreNoVideosAreNamed) {
  const std::string wave(
      "RIFF\x2c\0\0\0WAVEfmt \x10\0\0\0\1\0\1\0\x40\x1f\0\0\x80\x3e\0\0\2\0\x10\0"
      "data\x08\0\0\0\0\0\0\0\0\0\0\0",
      52);
  for (const std::string& content : {std::string(), std::string("no video at all"), wave}) {
    const fs::path file = root() / "clip.mp4";
    writeText(file, content);
    EXPECT_THROW(SequenceReader{viewOf(file)}, IoError);
    EXPECT_THAT(openingComplaint(viewOf(file)),
                testing::ContainsRegex("clip.mp4: (no video|sound only)"));
  }
  const fs::path cut = video("cut.mp4", "avc1");
  fs::resize_file(cut, fs::file_size(cut) / 2);  // the index is at the end
  EXPECT_THAT(openingComplaint(viewOf(cut)),
              AllOf(HasSubstr("cut.mp4"), HasSubstr("its index (moov) is missing")));
}

TEST_F(VideoTest, ContainersWithoutPicturesAreNamed) {
  for (const std::string name : {"empty.avi", "empty.mkv", "empty.mp4"}) {
    ASSERT_TRUE(writeVideo(root() / name, "MJPG", kRate, 0, grey));
  }
  writeText(root() / "sound.mp4", soundAsMp4());
  writeText(root() / "sound.mkv", soundAsMkv());
  for (const std::string name : {"empty.avi", "empty.mkv", "empty.mp4", "sound.mp4", "sound.mkv"}) {
    EXPECT_THROW(SequenceReader{viewOf(root() / name)}, IoError);
    EXPECT_THAT(openingComplaint(viewOf(root() / name)),
                testing::ContainsRegex(name + ": (no video|holds no image|sound only)"));
  }
}

TEST_F(VideoTest, AVideoThatEndsEarlyGivesTheImagesBefore) {
  const fs::path file = root() / "cut.avi";
  ASSERT_TRUE(writeVideo(file, "MJPG", kRate, kImages, [](int) {
    cv::Mat image(240, 320, CV_8UC3);
    cv::randu(image, cv::Scalar::all(0), cv::Scalar::all(256));
    return image;
  }));
  fs::resize_file(file, fs::file_size(file) / 2);
  SequenceReader reader(viewOf(file));
  int images = 0;
  try {
    while (reader.next()) ++images;
    ADD_FAILURE() << "nothing was thrown";
  } catch (const IoError& error) {
    EXPECT_THAT(error.what(), AllOf(HasSubstr("cut.avi"), HasSubstr("of about 30 images")));
  }
  EXPECT_GT(images, 5);
  EXPECT_LT(images, 20);
}

TEST_F(VideoTest, FourImagesOfACameraWait) {
  SequenceOptions o = viewOf(video());
  o.format = SequenceFormat::kCamera;
  SequenceReader reader(o);
  EXPECT_EQ(reader.format(), SequenceFormat::kCamera);
  std::vector<int> indices;
  int late = 0;
  while (const auto frame = reader.next()) {
    indices.push_back(frame->index);
    EXPECT_NEAR(frame->frame->timestamp(), frame->index / kRate, 0.0006);
    EXPECT_NEAR(levelOf(*frame), 50 + 5 * frame->index, 3);
    late += frame->late ? 1 : 0;
    std::this_thread::sleep_for(std::chrono::milliseconds(150));  // 4.5 images
  }
  EXPECT_GT(reader.dropped(), kImages / 2);
  EXPECT_EQ(static_cast<int>(indices.size()) + reader.dropped(), kImages);
  for (std::size_t i = 1; i < indices.size(); ++i) EXPECT_GT(indices[i], indices[i - 1]);
  ASSERT_GE(indices.size(), 5U);
  EXPECT_THAT(std::vector<int>(indices.end() - 4, indices.end()),
              testing::ElementsAre(kImages - 4, kImages - 3, kImages - 2, kImages - 1));
  EXPECT_GE(late + 2, static_cast<int>(indices.size())) << "but for the first and the last one";
}

TEST_F(VideoTest, ACameraEndsWhereItIsTold) {
  SequenceOptions o = viewOf(video());
  o.format = SequenceFormat::kCamera;
  o.end = 3;
  SequenceReader reader(o);
  EXPECT_EQ(readAll(reader).size(), 3U);
  o.every = 2;
  EXPECT_THAT(openingComplaint(o), HasSubstr("do not apply to a camera"));
  EXPECT_THAT(openingComplaint(viewOf("/dev/video987")),
              AllOf(HasSubstr("/dev/video987"), HasSubstr("no video")));
}

}  // namespace
}  // namespace dsorb
