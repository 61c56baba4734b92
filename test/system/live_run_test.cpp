// SPDX-License-Identifier: BSD-3-Clause
// The program as a live system: playback in real time, tracking beside mapping.
#include "support/dso_dataset_run.h"

#include <gmock/gmock.h>

namespace dsorb {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

class LiveRun : public DsoDataset {};

TEST_F(LiveRun, PipelinedRunAnswersEveryFrameAndWritesTheSameFiles) {
  const ProgramResult result = runOn(room_, {"--pipelined"});
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_THAT(readText(file("config.yaml")), HasSubstr("pipelined: true"));
  EXPECT_EQ(runJson()["frames_given"], kFrames);
  EXPECT_EQ(runJson()["frames_dropped"], 0);
  EXPECT_EQ(readTextLines(file("frames.csv")).size(), kFrames + 1U);
  EXPECT_EQ(readTextLines(file("trajectory_kitti.txt")).size(),
            readTextLines(file("trajectory.txt")).size());
  EXPECT_EQ(runJson()["keyframes"], readTextLines(file("keyframes.txt")).size());
  EXPECT_THAT(readText(file("points.ply")), HasSubstr("end_header"));
}

TEST_F(LiveRun, ALateRunDropsFramesAndSaysHowMany) {
  for (const char* mapping : {"--set=pipelined=false", "--pipelined"}) {
    const ProgramResult result =
        run({room_.string(), "--output", out().string(), "--speed", "1e6", mapping});
    EXPECT_TRUE(result.exit_code == 0 || result.exit_code == 3) << result.err;
    const int given = runJson()["frames_given"];
    const int dropped = runJson()["frames_dropped"];
    EXPECT_GE(dropped, kFrames / 2) << "a million times real time";
    EXPECT_EQ(given + dropped, kFrames);
    EXPECT_THAT(result.out, HasSubstr(", " + std::to_string(dropped) + " dropped"));
    const auto frames = readTextLines(file("frames.csv"));
    EXPECT_EQ(frames.size(), static_cast<std::size_t>(given) + 1);
    EXPECT_THAT(frames.back(), StartsWith(std::to_string(kFrames - 1) + ","))
        << "the newest image is never dropped";
  }
}

TEST_F(LiveRun, PlaybackWaitsForItsImages) {
  runOn(room_, {"--speed", "0.2", "--end", "8"});
  EXPECT_EQ(runJson()["frames_given"].get<int>() + runJson()["frames_dropped"].get<int>(), 8);
  EXPECT_GT(runJson()["seconds"]["total"].get<double>(), 7 * kSecondsBetweenImages / 0.2);
}

TEST_F(LiveRun, OriginalPresetsPlayBack) {
  const ProgramResult result =
      run({"files=" + (room_ / "images").string(), "preset=3", "speed=1e6", "quiet=1"});
  EXPECT_TRUE(result.exit_code == 0 || result.exit_code == 3) << result.err;
  const fs::path folder = folder_.path() / "out" / "images";
  EXPECT_THAT(readText(folder / "config.yaml"),
              AllOf(HasSubstr("pipelined: true"), HasSubstr("desired_points: 800")));
  EXPECT_GT(nlohmann::json::parse(readText(folder / "run.json"))["frames_dropped"], 0);
}

TEST_F(LiveRun, InterruptEndsASlowPlaybackAtOnce) {
  const fs::path table = file("frames.csv");
  run({room_.string(), "--output", out().string(), "--speed", "0.001", "--pipelined"},
      [&table] { return readTextLines(table).size() > 1; });
  EXPECT_EQ(runJson()["status"], "interrupted");
  EXPECT_EQ(runJson()["frames_given"], 1) << "the next image would be there after 33 s";
  EXPECT_THAT(readText(file("figures/trajectory.png")), Not(""));
}

}  // namespace
}  // namespace dsorb
