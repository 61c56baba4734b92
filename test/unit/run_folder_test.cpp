// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/error.h"
#include "dsorb/io/writers.h"

#include "support/fake_run.h"
#include "support/temporary_folder.h"
#include "support/text_files.h"

#include <gmock/gmock.h>

#include <fstream>
#include <limits>

namespace dsorb {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr double kNan = std::numeric_limits<double>::quiet_NaN();

TEST(RunFolder, SummaryIsValidFromTheBeginning) {
  const TemporaryFolder folder;
  FakeRun run(folder.path());
  EXPECT_EQ(readJson(folder.path() / "run.json")["status"], "error") << "if it was killed now";
  playOneSegment(run);
  OdometryReport report;
  report.tracking_seconds = 1.5;
  run.writer.finish(RunStatus::kInterrupted, &report);
  const auto json = readJson(folder.path() / "run.json");
  EXPECT_EQ(json["program"], "test");
  EXPECT_EQ(json["version"], "1.2.3");
  EXPECT_EQ(json["dataset"], "a \"quoted\" name");
  EXPECT_EQ(json["initializer"], "orb-v1");
  EXPECT_EQ(json["camera"]["fx"], 100.0);
  EXPECT_FALSE(json.contains("refined_camera"));
  EXPECT_EQ(json["frames_given"], 5);
  EXPECT_EQ(json["frames_tracked"], 2);
  EXPECT_EQ(json["frames_dropped"], 0);
  EXPECT_EQ(json["keyframes"], 1);
  EXPECT_EQ(json["segments"], 1);
  EXPECT_EQ(json["status"], "interrupted");
  EXPECT_NEAR(json["seconds"]["reading"], 0.005, 1e-9);
  EXPECT_EQ(json["seconds"]["tracking"], 1.5);
  EXPECT_GT(json["seconds"]["writing"], 0);
  EXPECT_GE(json["seconds"]["total"], json["seconds"]["writing"]);
  EXPECT_GT(json["peak_memory_mb"], 1);
  EXPECT_EQ(json["threads"], 1);
  EXPECT_EQ(readText(folder.path() / "config.yaml"), "num_threads: 1\n");
}

TEST(RunFolder, ANameThatIsNoUtf8IsTold) {
  const TemporaryFolder folder;
  RunInfo info = FakeRun::info();
  info.dataset = "r\xff";
  RunWriter writer(folder.path().string(), info);
  writer.finish(writer.outcome(), nullptr);
  const auto json = readJson(folder.path() / "run.json");
  EXPECT_EQ(json["dataset"], "r\xEF\xBF\xBD");
  EXPECT_EQ(json["dataset_uri"], "file://r%FF");
}

TEST(RunFolder, RunWithoutFramesIsValid) {
  const TemporaryFolder folder;
  FakeRun run(folder.path());
  EXPECT_EQ(run.writer.outcome(), RunStatus::kNeverInitialized);
  run.writer.finish(run.writer.outcome(), nullptr);
  for (const char* file :
       {"trajectory.txt", "keyframes.txt", "frames.csv", "points.ply", "figures/trajectory.png"}) {
    EXPECT_TRUE(fs::exists(folder.path() / file)) << file;
  }
}

TEST(RunFolder, NotANumberNeverReachesAFile) {
  const TemporaryFolder folder;
  FakeRun run(folder.path());
  playOneSegment(run);
  FrameEstimate estimate;
  estimate.frame = makeFrame(5);
  estimate.state = OdometryState::kTracked;
  estimate.T_world_cam = translated(kNan);
  estimate.tracking_rmse = std::numeric_limits<double>::infinity();
  run.writer.onFrame(estimate);
  run.writer.frameDone({1, 1});
  run.writer.finish(run.writer.outcome(), nullptr);
  for (const char* file : {"trajectory.txt", "frames.csv", "initialization.json", "run.json"}) {
    const std::string text = readText(folder.path() / file);
    EXPECT_THAT(text, Not(HasSubstr("nan"))) << file;
    EXPECT_THAT(text, Not(HasSubstr("inf,"))) << file;
  }
}

TEST(RunFolder, RemovesTheFilesOfAnEarlierRunAndNothingElse) {
  const TemporaryFolder folder;
  fs::create_directories(folder.path() / "figures");
  for (const char* file : {"trajectory_3.txt",
                           "trajectory_kitti.txt",
                           "keyframes_12.txt",
                           "run.json.part",
                           "figures/initial_inverse_depth_2.png",
                           "notes.txt",
                           "trajectory_mine.txt",
                           "figures/mine.png"}) {
    std::ofstream(folder.path() / file) << "old";
  }
  std::ofstream(folder.path() / "run.json") << R"({"program": "test"})";
  FakeRun run(folder.path());
  for (const char* file : {"trajectory_3.txt",
                           "trajectory_kitti.txt",
                           "keyframes_12.txt",
                           "run.json.part",
                           "figures/initial_inverse_depth_2.png"}) {
    EXPECT_FALSE(fs::exists(folder.path() / file)) << file;
  }
  for (const char* file : {"notes.txt", "trajectory_mine.txt", "figures/mine.png"}) {
    EXPECT_TRUE(fs::exists(folder.path() / file)) << file;
  }
}

/// Message of the IoError that a run into this folder throws.
std::string complaintOfRunInto(const fs::path& folder) {
  try {
    FakeRun run(folder);
  } catch (const IoError& error) {
    return error.what();
  }
  return "nothing was thrown";
}

TEST(RunFolder, FilesThatNoRunWroteAreNotReplaced) {
  for (const char* summary : {"", "{}", R"({"program": "another"})"}) {
    const TemporaryFolder folder;
    std::ofstream(folder.path() / "config.yaml") << "mine";
    if (*summary != '\0') std::ofstream(folder.path() / "run.json") << summary;
    EXPECT_THAT(complaintOfRunInto(folder.path()),
                AllOf(HasSubstr(folder.path().string()), HasSubstr("not from a run of test")));
    EXPECT_EQ(readText(folder.path() / "config.yaml"), "mine");
    EXPECT_EQ(readText(folder.path() / "run.json"), summary);
  }
}

TEST(RunFolder, TwoRunsDoNotShareAFolder) {
  const TemporaryFolder folder;
  {
    FakeRun run(folder.path());
    playOneSegment(run);
    EXPECT_THAT(complaintOfRunInto(folder.path()), HasSubstr("another run writes into it"));
    run.writer.finish(run.writer.outcome(), nullptr);
  }
  EXPECT_EQ(readJson(folder.path() / "run.json")["frames_given"], 5);
  EXPECT_EQ(complaintOfRunInto(folder.path()), "nothing was thrown");
}

TEST(RunFolder, UnwritableFolderIsNamed) {
  const TemporaryFolder folder;
  std::ofstream(folder.path() / "file") << "x";
  const std::string below = (folder.path() / "file" / "out").string();
  try {
    FakeRun run{fs::path(below)};
    FAIL() << "wrote below a file";
  } catch (const IoError& error) {
    EXPECT_THAT(error.what(), HasSubstr(below));
  }
}

}  // namespace
}  // namespace dsorb
