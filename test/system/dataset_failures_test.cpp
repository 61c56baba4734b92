// SPDX-License-Identifier: BSD-3-Clause
// The program where something goes wrong around it: streams, wrong options, unreadable images.
#include "support/dso_dataset_run.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <fstream>
#include <thread>
#include <vector>

namespace dsorb {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::Not;

class DatasetFailures : public DsoDataset {
 protected:
  [[nodiscard]] std::string roomWithBar() const {
    return "$dso --initializer orb-v1 --progress on --output " + out().string() + " " +
           room_.string();
  }
};

TEST_F(DatasetFailures, ClosedStandardErrorDoesNotSendTheBarIntoAFile) {
  EXPECT_EQ(shell(roomWithBar() + " >&- 2>&- <&-").exit_code, 0);
  EXPECT_EQ(readTextLines(file("frames.csv")).size(), kFrames + 1U);
  for (const auto& entry : fs::directory_iterator(out())) {
    if (entry.is_directory()) continue;
    EXPECT_THAT(readText(entry.path()), Not(HasSubstr("frames/s"))) << entry.path();
  }
}

TEST_F(DatasetFailures, RunGoesOnWhereNobodyListens) {
  // The right side leaves before the first bar is drawn.
  EXPECT_EQ(shell("(sleep 0.05; " + roomWithBar() + " 2>&1; echo $? >code) | true; cat code").out,
            "0\n");
  EXPECT_EQ(runJson()["status"], "tracked");
  EXPECT_EQ(runJson()["frames_given"], kFrames);
}

TEST_F(DatasetFailures, HelpThatCannotBePrintedIsAnError) {
  for (const char* words : {"--help", "--print-config"}) {
    const ProgramResult result = shell(std::string("$dso ") + words + " >/dev/full");
    EXPECT_EQ(result.exit_code, 1) << words;
    EXPECT_THAT(result.err, HasSubstr("standard output"));
  }
}

TEST_F(DatasetFailures, WrongRangeLeavesTheEarlierResults) {
  ASSERT_EQ(runOn(room_).exit_code, 0);
  const std::string trajectory = readText(file("trajectory.txt"));
  const ProgramResult result = runOn(room_, {"--start", "24"});
  EXPECT_EQ(result.exit_code, 2);
  EXPECT_THAT(result.err,
              HasSubstr("start: 24 lies outside the sequence of 24 images; expected 0 to 23"));
  EXPECT_EQ(readText(file("trajectory.txt")), trajectory);
  EXPECT_EQ(runJson()["status"], "tracked");
}

TEST_F(DatasetFailures, AFileThatIsNotThereLeavesTheEarlierResults) {
  ASSERT_EQ(runOn(room_).exit_code, 0);
  const std::string earlier = readText(file("trajectory.txt"));
  for (const char* const option : {"--calib", "--gamma", "--vignette", "--mask"}) {
    const ProgramResult result = runOn(room_, {option, "nix.bin"});
    EXPECT_EQ(result.exit_code, 1) << option;
    EXPECT_THAT(result.err, HasSubstr("nix.bin: no such file")) << option;
  }
  EXPECT_EQ(readText(file("trajectory.txt")), earlier);
}

TEST_F(DatasetFailures, RunThatNeverInitializedSaysWhatItWaitedFor) {
  const ProgramResult result = run({room_.string(), "--end", "1"});
  EXPECT_EQ(result.exit_code, 3);
  EXPECT_THAT(result.out, HasSubstr("the initializer's last answer: first_frame"));
  EXPECT_THAT(run({room_.string(), "--initializer", "orb-v1"}).out, Not(HasSubstr("last answer")));
}

TEST_F(DatasetFailures, RecordingOfAFailedRunSaysSo) {
  const fs::path copy = copyOfRoom();
  std::ofstream(copy / "images" / "00012.png") << "no image";
  const ProgramResult result = runOn(copy, {"--record", file("run.jsonl").string()});
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_THAT(result.err, HasSubstr("00012.png"));
  EXPECT_EQ(readTextLines(file("run.jsonl")).back(), R"({"kind":"end","status":"error"})");
}

TEST_F(DatasetFailures, RecordingDoesNotTakeThePlaceOfAResult) {
  for (const char* name : {"run.json", "../out/points.ply", "figures/trajectory.png"}) {
    const ProgramResult result = runOn(room_, {"--record", file(name).string()});
    EXPECT_EQ(result.exit_code, 2) << name;
    EXPECT_THAT(result.err, HasSubstr("the run itself writes a file of this name"));
  }
}

TEST_F(DatasetFailures, RecordingReplacesRecordingsAlone) {
  const fs::path copy = copyOfRoom();
  const std::string camera = readText(copy / "camera.txt");
  const ProgramResult result = runOn(copy, {"--record", (copy / "camera.txt").string()});
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_THAT(result.err, HasSubstr("is no recording, and would be replaced"));
  EXPECT_EQ(readText(copy / "camera.txt"), camera);
  EXPECT_FALSE(fs::exists(file("run.json")));
}

TEST_F(DatasetFailures, FiguresDoNotFollowALink) {
  fs::create_directories(folder_.path() / "others");
  fs::create_directories(out());
  std::ofstream(folder_.path() / "others" / "trajectory.png") << "mine";
  fs::create_directory_symlink("../others", file("figures"));
  const ProgramResult result = runOn(room_);
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_THAT(result.err, HasSubstr("figures there is a link"));
  EXPECT_EQ(readText(folder_.path() / "others" / "trajectory.png"), "mine");
}

TEST_F(DatasetFailures, MoreThreadsThanTheMachineHasAreNoReasonForAWord) {
  const ProgramResult result = runOn(room_, {"--threads", "64", "--end", "8"});
  EXPECT_EQ(result.err, "");
  EXPECT_LE(runJson()["threads"].get<unsigned>(), std::thread::hardware_concurrency());
}

TEST_F(DatasetFailures, MemoryIsThatOfTheProgramAndNotOfItsParent) {
  const std::size_t parents = std::size_t{400} << 20U;
  const std::vector<char> block(parents, 1);
  ASSERT_EQ(runOn(room_, {"--end", "2"}).exit_code, 3);
  EXPECT_LT(runJson()["peak_memory_mb"].get<double>(), 200);
  EXPECT_EQ(block.back(), 1);
}

TEST_F(DatasetFailures, InterruptEndsALoadThatWaits) {
  const fs::path pipe = folder_.path() / "pipe";
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  const int writer = open(pipe.c_str(), O_RDWR);  // somebody who never writes
  using Clock = std::chrono::steady_clock;
  const Clock::time_point begin = Clock::now();
  // A busy machine takes up to a second to load the libraries, before there is a signal handler.
  const auto later = [&begin] { return Clock::now() - begin > std::chrono::seconds(2); };
  const ProgramResult result =
      run({room_.string(), "--output", out().string(), "--calib", pipe.string()}, later);
  EXPECT_LT(std::chrono::duration<double>(Clock::now() - begin).count(), 5.5) << "three expected";
  close(writer);
  EXPECT_EQ(result.exit_code, 3);
  EXPECT_EQ(runJson()["status"], "interrupted");
  EXPECT_EQ(runJson()["frames_given"], 0);
}

}  // namespace
}  // namespace dsorb
