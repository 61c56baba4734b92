// SPDX-License-Identifier: BSD-3-Clause
// dso_dataset over videos that are encoded from the rendered room.
#include "support/dso_dataset_run.h"
#include "support/video_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/imgcodecs.hpp>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <string>
#include <utility>
#include <vector>

namespace dsorb {
namespace {

namespace fs = std::filesystem;
using testing::AllOf;
using testing::HasSubstr;

class VideoRun : public DsoDataset {
 protected:
  /// The room as a video, beside its calibration. @param rounds forwards and backwards in turn
  [[nodiscard]] fs::path encode(const std::string& name,
                                const std::string& codec,
                                int rounds = 1) const {
    const fs::path file = folder_.path() / name;
    std::vector<fs::path> files;
    for (const auto& entry : fs::directory_iterator(room_ / "images"))
      files.push_back(entry.path());
    std::sort(files.begin(), files.end());
    EXPECT_EQ(files.size(), static_cast<std::size_t>(kFrames));
    const auto image = [&files](int i) {
      const int step = i % (2 * kFrames - 2);
      const int index = step < kFrames ? step : 2 * kFrames - 2 - step;
      return cv::imread(files[static_cast<std::size_t>(index)].string(), cv::IMREAD_COLOR);
    };
    EXPECT_TRUE(writeVideo(file, codec, 30, rounds * kFrames, image)) << codec;
    return file;
  }
  [[nodiscard]] ProgramResult runVideo(const fs::path& video,
                                       std::vector<std::string> more = {}) const {
    more.insert(more.begin(), {"--calib", (room_ / "camera.txt").string()});
    return runOn(video, more);
  }
};

TEST_F(VideoRun, TracksMotionJpegAndH264) {
  for (const auto& [name, codec] : {std::pair("room.avi", "MJPG"), std::pair("room.mp4", "avc1")}) {
    const ProgramResult result = runVideo(encode(name, codec));
    EXPECT_EQ(result.exit_code, 0) << name << result.err;
    EXPECT_EQ(runJson()["status"], "tracked") << name;
    EXPECT_EQ(runJson()["frames_given"], kFrames) << name;
  }
}

TEST_F(VideoRun, KeepsWhatWasComputedWhereTheVideoIsCut) {
  const fs::path video = encode("room.avi", "MJPG", 2);
  fs::resize_file(video, fs::file_size(video) * 6 / 10);
  const ProgramResult result = runVideo(video);
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_THAT(result.err, AllOf(HasSubstr("room.avi: ends after"), HasSubstr("of 48 images")));
  EXPECT_EQ(runJson()["status"], "error");
  EXPECT_GT(runJson()["frames_given"], kFrames / 2);
  EXPECT_GT(fs::file_size(file("trajectory.txt")), 0U);
}

TEST_F(VideoRun, RefusesWhatIsNoVideo) {
  const fs::path video = folder_.path() / "sound.mp4";
  std::ofstream(video) << "no picture in it";
  const ProgramResult result = runVideo(video);
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_THAT(result.err, AllOf(HasSubstr("sound.mp4"), HasSubstr("no video that can be decoded")));
  EXPECT_EQ(runJson()["status"], "error");
}

TEST_F(VideoRun, ACameraRunsUntilItIsInterrupted) {
  const fs::path video = encode("room.avi", "MJPG", 20);  // 16 s
  const fs::path table = file("frames.csv");
  const ProgramResult result = run({video.string(),
                                    "--format",
                                    "camera",
                                    "--calib",
                                    (room_ / "camera.txt").string(),
                                    "--initializer",
                                    "orb-v1",
                                    "--output",
                                    out().string()},
                                   [table] { return readTextLines(table).size() > kFrames; });
  const nlohmann::json json = runJson();
  EXPECT_EQ(json["status"], "interrupted") << result.err;
  EXPECT_GT(json["frames_given"], kFrames / 2);
  EXPECT_LT(json["frames_given"], 20 * kFrames);
  EXPECT_GT(fs::file_size(file("trajectory.txt")), 0U);
}

TEST_F(VideoRun, ALateRunOfACameraSaysHowManyImagesItMissed) {
  const fs::path video = encode("room.avi", "MJPG", 3);
  const ProgramResult result =
      runVideo(video, {"--format", "camera", "--set", "initializer.orb.max_frames=20"});
  const nlohmann::json json = runJson();
  EXPECT_EQ(json["frames_given"].get<int>() + json["frames_dropped"].get<int>(), 3 * kFrames)
      << result.err;
}

}  // namespace
}  // namespace dsorb
