// SPDX-License-Identifier: BSD-3-Clause
// The program where something goes wrong around it: streams, wrong options, unreadable images.
#include "support/dso_dataset_run.h"

#include <gmock/gmock.h>

#include <fstream>

namespace dsorb {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::Not;

class DatasetFailures : public DsoDataset {
 protected:
  /// Runs a line of shell in which $dso is the program.
  [[nodiscard]] ProgramResult shell(const std::string& line) const {
    return runProgram({"/bin/bash", "-c", "dso=" DSORB_DATASET "; " + line}, folder_.path());
  }
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

}  // namespace
}  // namespace dsorb
