// SPDX-License-Identifier: BSD-3-Clause
// dso_dataset over videos that are encoded from the rendered room.
#include "support/dso_dataset_run.h"
#include "support/video_file.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/imgcodecs.hpp>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <string>
#include <thread>
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
  /// The words of a run on a camera.
  [[nodiscard]] std::vector<std::string> cameraWords(const fs::path& camera) const {
    return {camera.string(),
            "--format",
            "camera",
            "--calib",
            (room_ / "camera.txt").string(),
            "--initializer",
            "orb-v1",
            "--output",
            out().string()};
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
  EXPECT_THAT(result.err,
              AllOf(HasSubstr("room.avi: ends after"), HasSubstr("of about 48 images")));
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
  const ProgramResult result = run(cameraWords(video), [table] {
    return readText(table).find(",tracked,") != std::string::npos;
  });
  const nlohmann::json json = runJson();
  EXPECT_EQ(json["status"], "interrupted") << result.err;
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

/// Sends bytes through a pipe at the speed of a camera, about 60 images a second of the room.
class PipeFeeder {
 public:
  PipeFeeder(const fs::path& pipe, std::string bytes, bool stays_open)
      : bytes_(std::move(bytes)), stays_open_(stays_open) {
    EXPECT_EQ(mkfifo(pipe.c_str(), 0600), 0);
    end_ = open(pipe.c_str(), O_RDWR | O_NONBLOCK | O_CLOEXEC);  // does not wait for a reader
    thread_ = std::thread([this] { feed(); });
  }
  ~PipeFeeder() {
    reader_ended_ = true;
    thread_.join();
  }
  PipeFeeder(const PipeFeeder&) = delete;
  PipeFeeder& operator=(const PipeFeeder&) = delete;

  /// Since everything was sent [s]; negative: not yet.
  [[nodiscard]] double silence() const {
    return sent_ ? std::chrono::duration<double>(Clock::now() - last_).count() : -1;
  }

 private:
  using Clock = std::chrono::steady_clock;
  void feed() {
    constexpr std::size_t kPiece = 15000;  // [bytes], about an image
    for (std::size_t at = 0; at < bytes_.size() && !reader_ended_;) {
      const ssize_t sent = write(end_, bytes_.data() + at, std::min(kPiece, bytes_.size() - at));
      if (sent > 0) at += static_cast<std::size_t>(sent);
      std::this_thread::sleep_for(std::chrono::milliseconds(15));
    }
    last_ = Clock::now();
    sent_ = true;
    while (stays_open_ && !reader_ended_) {
      std::this_thread::sleep_for(std::chrono::milliseconds(15));
    }
    close(end_);
  }

  std::string bytes_;
  bool stays_open_;
  int end_ = -1;
  std::atomic<bool> reader_ended_{false};
  std::atomic<bool> sent_{false};
  Clock::time_point last_;
  std::thread thread_;
};

class CameraThatStops : public VideoRun {
 protected:
  /// @return seconds from the last bytes to the end of the program
  double runOnPipe(bool stays_open, double interrupted_after = -1) {
    const std::string video = readText(encode("room.avi", "MJPG", 20));
    const fs::path pipe = folder_.path() / "camera";
    const PipeFeeder feeder(pipe, video.substr(0, video.size() / 2), stays_open);
    const auto interrupt = [&feeder, interrupted_after] {
      return interrupted_after >= 0 && feeder.silence() > interrupted_after;
    };
    result_ = run(cameraWords(pipe), interrupt);
    return feeder.silence();
  }
  void expectResults(const char* status) const {
    const nlohmann::json json = runJson();
    EXPECT_EQ(json["status"], status);
    EXPECT_GT(json["frames_given"], 0);  // 50 on an idle machine, 11 on one with 7 times the load
    EXPECT_EQ(fs::file_size(file("trajectory.txt")) > 0, json["frames_tracked"] > 0);
  }

  ProgramResult result_;
};

TEST_F(CameraThatStops, GoesAway) {
  EXPECT_LT(runOnPipe(false), 5);  // at once; 5.5 would be a silent one's end
  EXPECT_EQ(result_.exit_code, 1);
  EXPECT_THAT(result_.err, testing::ContainsRegex("the camera went away after [0-9]+ images"));
  expectResults("error");
}

TEST_F(CameraThatStops, FallsSilent) {
  EXPECT_LT(runOnPipe(true), 10);  // measured 6.1
  EXPECT_EQ(result_.exit_code, 1);
  EXPECT_THAT(result_.err, HasSubstr("camera: no image for five seconds"));
  expectResults("error");
}

TEST_F(CameraThatStops, IsSilentWhenItIsInterrupted) {
  EXPECT_LT(runOnPipe(true, 2), 5);  // measured 2.7
  expectResults("interrupted");
}

}  // namespace
}  // namespace dsorb
