// SPDX-License-Identifier: BSD-3-Clause
// Where the times of images come from, and in which unit.
#include "dsorb/io/sequence_reader.h"

#include "support/sequence_fixture.h"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>
#include <vector>

namespace dsorb {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

class ImageTimesTest : public SequenceFixture {
 protected:
  void writeTimes(const std::string& times) { writeText(root() / "times.txt", times); }
  /// Images of these names instead of 000000 and so on.
  void nameImages(const std::vector<std::string>& names) {
    fs::remove_all(root() / "images");
    fs::remove(root() / "times.txt");
    for (const std::string& name : names) {
      writeImage(root() / "images" / (name + ".png"), cv::Mat(48, 64, CV_8UC1, cv::Scalar(90)));
    }
  }
  /// Expects the second image at a time, and warnings that hold these words.
  void expectTime(double time, const std::vector<std::string>& words) {
    const SequenceReader reader(options());
    EXPECT_NEAR(reader.timestamp(1), time, 1e-6);
    ASSERT_EQ(reader.warnings().size(), words.size());
    for (std::size_t i = 0; i < words.size(); ++i) {
      EXPECT_THAT(reader.warnings()[i], HasSubstr(words[i]));
    }
  }
};

TEST_F(ImageTimesTest, OneColumnIsTheTime) {
  writeDso(3);
  writeTimes("0.5\n0.6\n0.7\n");
  expectTime(0.6, {});
  writeTimes("1403636579763555584\n1403636579813555456\n1403636579863555584\n");
  expectTime(1403636579.813555456, {"nanoseconds"});
  writeTimes("0.5\n1 0.6\n0.7\n");
  EXPECT_THAT(openingComplaint(options()), AllOf(HasSubstr("times.txt:2"), HasSubstr("seconds")));
}

TEST_F(ImageTimesTest, TheUnitIsThatInWhichACameraTakesImages) {
  writeDso(3);
  const struct {
    const char* times;
    double second;
    const char* unit;
  } cases[] = {
      {"1403636579763\n1403636579813\n1403636579863\n", 1403636579.813, "milliseconds"},
      {"1403636579763555\n1403636579813555\n1403636579863555\n", 1403636579.813555, "microseconds"},
      {"0\n33\n67\n", 0.033, "milliseconds"},
      {"0\n33.333\n66.667\n", 0.033333, "milliseconds"},
      {"0\n33333\n66667\n", 0.033333, "microseconds"},
      {"0\n33333333\n66666667\n", 0.033333333, "nanoseconds"}};
  for (const auto& c : cases) {
    SCOPED_TRACE(c.times);
    writeTimes(c.times);
    expectTime(c.second, {c.unit});
  }
  writeTimes("1700000000\n1700000005\n1700000010\n");
  expectTime(1700000005, {});
  writeDso(4);
  writeTimes("0.1\n0.2\n0.3\n1600000000.3\n");
  expectTime(0.2, {"1.6e+09 s between images 2 and 3"});
}

TEST_F(ImageTimesTest, AListOfEurocMayHaveAnotherUnit) {
  writeGreyImages(root() / "cam1" / "data", 3, ".png");
  writeText(root() / "camera.txt", "Pinhole 50 50 31.5 23.5 0\n64 48\nnone\n64 48\n");
  SequenceOptions o = options();
  o.calibration_file = root() / "camera.txt";
  const auto second = [&](const char* prefix, std::size_t warnings) {
    std::string list;
    for (int i = 0; i < 3; ++i) list += fmt::format("{}{},{:06d}.png\n", i + 1, prefix, i);
    writeText(root() / "cam1" / "data.csv", list);
    const SequenceReader reader(o);
    EXPECT_EQ(reader.warnings().size(), warnings);
    return reader.timestamp(1);
  };
  EXPECT_NEAR(second("00000000", 0), 0.2, 1e-9);
  EXPECT_NEAR(second("00000", 1), 0.2, 1e-9) << "microseconds";
  EXPECT_NEAR(second("00", 1), 0.2, 1e-9) << "milliseconds";
}

TEST_F(ImageTimesTest, NamesThatAreTimesAreTheTimes) {
  writeDso(1);
  const std::string told = "their names are taken for their times";
  nameImages({"1305031102.175304", "1305031102.211214", "1305031102.243211"});
  expectTime(1305031102.211214, {told});
  nameImages({"1403715273262142976", "1403715273312143104", "1403715273362142976"});
  expectTime(1403715273.312143104, {told, "nanoseconds"});
  nameImages({"frame_1403715273262", "frame_1403715273312", "frame_1403715273362"});
  expectTime(1403715273.312, {told, "milliseconds"});
  nameImages({"0.000", "0.033", "0.067"});
  expectTime(0.033, {told});
}

TEST_F(ImageTimesTest, NamesThatAreNumbersAreNoTimes) {
  writeDso(1);
  for (const std::vector<std::string>& names : {std::vector<std::string>{"000000", "000001"},
                                                {"100", "200"},
                                                {"20231105", "20231106"},
                                                {"IMG_0001", "IMG_0002"},
                                                {"a1305031102.175304", "b1305031102.211214"}}) {
    nameImages(names);
    expectTime(0.1, {"0.1 s apart"});
  }
}

TEST_F(ImageTimesTest, RawDataOfKittiHasDates) {
  const fs::path drive = root() / "2011_09_26" / "2011_09_26_drive_0001_sync";
  for (int i = 0; i < 2; ++i) {
    writeImage(drive / "image_02" / "data" / fmt::format("{:010d}.png", i),
               cv::Mat(48, 64, CV_8UC1, cv::Scalar(90)));
  }
  writeText(drive / "image_02" / "timestamps.txt",
            "2011-09-26 13:02:25.964389445\n2011-09-26 13:02:26.067931126\n");
  writeText(root() / "2011_09_26" / "calib_cam_to_cam.txt", "calib_time: 09-Jan-2012 13:57:47\n");
  writeText(root() / "camera.txt", "Pinhole 50 50 31.5 23.5 0\n64 48\nnone\n64 48\n");
  for (const fs::path& path :
       {root() / "2011_09_26", drive, drive / "image_02", drive / "image_02" / "data"}) {
    SequenceOptions o = optionsFor(path);
    o.calibration_file = root() / "camera.txt";
    const SequenceReader reader(o);
    EXPECT_EQ(reader.format(), SequenceFormat::kKitti) << path;
    EXPECT_NEAR(reader.timestamp(0), 1317042145.964389445, 1e-6);
    EXPECT_NEAR(reader.timestamp(1), 1317042146.067931126, 1e-6);
  }
}

TEST_F(ImageTimesTest, AssociationsAreAListOfTum) {
  writeGreyImages(root() / "rgb", 2, ".png");
  writeText(root() / "camera.txt", "Pinhole 50 50 31.5 23.5 0\n64 48\nnone\n64 48\n");
  for (const char* line :
       {"{0} rgb/{1}.png {0} depth/{1}.png\n", "{0} depth/{1}.png {0} rgb/{1}.png\n"}) {
    writeText(root() / "associations.txt",
              fmt::format(line, "1.1", "000000") + fmt::format(line, "1.2", "000001"));
    SequenceReader reader(options());
    EXPECT_EQ(reader.format(), SequenceFormat::kTum);
    EXPECT_NEAR(reader.timestamp(1), 1.2, 1e-9);
    EXPECT_THAT(readAll(reader)[1].image_file, HasSubstr("rgb/000001.png"));
  }
}

}  // namespace
}  // namespace dsorb
