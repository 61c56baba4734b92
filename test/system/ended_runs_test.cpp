// SPDX-License-Identifier: BSD-3-Clause
// Runs that do not come to their end: killed, out of disk, without their folder. What they leave
// can be read.
#include "support/dso_dataset_run.h"

#include <fmt/format.h>
#include <gmock/gmock.h>

#include <algorithm>
#include <chrono>
#include <random>

namespace dsorb {
namespace {

constexpr int kFrameColumns = 58;  // of frames.csv: docs/formats.md

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::MatchesRegex;

class EndedRuns : public DsoDataset {
 protected:
  /// The program with the room, its output in the folder "out".
  [[nodiscard]] std::string program(const std::string& options = "") const {
    return "$dso --quiet --initializer orb-v1 --output " + out().string() + " " + options + " " +
           room_.string();
  }
  /// Starts a run and halts it when it has its folder; $! is its process.
  [[nodiscard]] std::string haltedRun() const {
    return program() + " & until [ -s out/run.json ]; do sleep .005; done; kill -STOP $!; ";
  }
  [[nodiscard]] bool holds(const std::string& name) const { return fs::exists(file(name)); }

  /// Whatever lies in the folder is whole.
  void expectReadable() const {
    if (!fs::exists(out())) return;
    for (const auto& entry : fs::recursive_directory_iterator(out())) {
      const fs::path& path = entry.path();
      const std::string text = entry.is_regular_file() ? readText(path) : "";
      if (path.extension() == ".json") {
        EXPECT_FALSE(nlohmann::json::parse(text, nullptr, false).is_discarded()) << path << text;
      } else if (path.extension() == ".png") {
        EXPECT_THAT(text, HasSubstr("IEND")) << path;
      } else if (path.extension() == ".ply") {
        expectWholePly(text);
      } else if (path.extension() == ".csv") {
        expectLinesOf(kFrameColumns, ',', path, text);
      } else if (path.extension() == ".txt") {
        expectLinesOf(path.stem() == "trajectory_kitti" ? 12 : 8, ' ', path, text);
      }
    }
  }

 private:
  static void expectLinesOf(int fields,
                            char separator,
                            const fs::path& path,
                            const std::string& text) {
    EXPECT_TRUE(text.empty() || text.back() == '\n') << path;
    for (const std::string& line : readTextLines(path)) {
      EXPECT_EQ(std::count(line.begin(), line.end(), separator), fields - 1)
          << path << ": " << line;
    }
  }
  static void expectWholePly(const std::string& text) {
    const std::string end = "end_header\n";
    ASSERT_THAT(text, HasSubstr(end));
    const std::size_t body = text.size() - text.find(end) - end.size();
    const std::size_t vertices = countOf("element vertex ", text);
    const std::size_t observations = countOf("element observation ", text);  // of tracks.ply
    EXPECT_EQ(body, observations > 0 ? 16 * (vertices + observations) : 27 * vertices);
  }
  static std::size_t countOf(const std::string& element, const std::string& text) {
    const std::size_t at = text.find(element);
    return at == std::string::npos ? 0 : std::stoul(text.substr(at + element.size()));
  }
};

TEST_F(EndedRuns, KilledAtAnyMomentLeavesFilesThatCanBeRead) {
  using Clock = std::chrono::steady_clock;
  const Clock::time_point begin = Clock::now();
  ASSERT_EQ(shell(program()).exit_code, 0);
  const double seconds = std::chrono::duration<double>(Clock::now() - begin).count();
  std::mt19937 random(15);  // NOLINT(cert-msc51-cpp): the same moments in every run
  std::uniform_real_distribution<double> moment(0, 1);
  int killed = 0;
  int begun = 0;
  for (int trial = 0; trial < 10; ++trial) {
    const std::string command =
        fmt::format("timeout -s KILL {:.3f} {}", seconds * moment(random), program());
    killed += shell(command).exit_code == 0 ? 0 : 1;
    begun += holds("frames.csv") ? 1 : 0;
    SCOPED_TRACE(command);
    expectReadable();
  }
  EXPECT_GE(killed, 2) << "the others had come to their end; most are killed on an idle machine";
  EXPECT_GE(begun, 2);
  ASSERT_EQ(shell(program()).exit_code, 0) << "a run that was killed is not in the way";
  for (const auto& entry : fs::recursive_directory_iterator(out())) {
    EXPECT_NE(entry.path().extension(), ".part") << entry.path();
  }
}

TEST_F(EndedRuns, FileThatExceedsItsLimitIsNamed) {
  for (const int kib : {1, 8, 64}) {
    fs::remove_all(out());
    const ProgramResult result = shell(fmt::format("ulimit -f {}; {}", kib, program()));
    EXPECT_EQ(result.exit_code, 1) << kib;
    EXPECT_THAT(result.err,
                MatchesRegex("dso_dataset: error: " + out().string() +
                             "[a-z_/.]*: cannot be written: File too large\n"));
    expectReadable();
  }
}

TEST_F(EndedRuns, FullDiskIsNamed) {
  if (shell("unshare -rm mount -t tmpfs none /mnt").exit_code != 0) {
    GTEST_SKIP()
        << "no disk of its own for this user; FileThatExceedsItsLimitIsNamed does the same";
  }
  for (const int kib : {16, 60, 200}) {
    // The disk is seen by its own processes only: what lies there is copied out.
    const std::string disk = (folder_.path() / "disk").string();
    fs::create_directories(disk);
    fs::remove_all(out());
    const ProgramResult result = shell(
        fmt::format("export dso; unshare -rm /bin/bash -c 'mount -t tmpfs -o size={0}k none {1} && "
                    "$dso --quiet --initializer orb-v1 --output {1}/run {2}; code=$?; cp -r "
                    "{1}/run {3}; exit $code'",
                    kib,
                    disk,
                    room_.string(),
                    out().string()));
    EXPECT_EQ(result.exit_code, 1) << kib;
    EXPECT_THAT(result.err,
                MatchesRegex("dso_dataset: error: " + disk +
                             "/run[a-z_/.]*: cannot be written: No space left on device\n"));
    expectReadable();
  }
}

TEST_F(EndedRuns, FolderThatIsRemovedIsNamed) {
  const ProgramResult result = shell(haltedRun() + "rm -rf out; kill -CONT $!; wait $!; exit $?");
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_THAT(result.err,
              MatchesRegex("dso_dataset: error: " + out().string() +
                           "/[a-z_/.]*: cannot be written: No such file or directory\n"));
}

TEST_F(EndedRuns, AHangupEndsARunButForNohup) {
  const std::string slow = program("--speed .1") +
                           " & until [ -s out/frames.csv ]; do sleep .005; "
                           "done; kill -HUP $!; wait $!; echo $?";
  EXPECT_EQ(shell(slow).out, "3\n");
  EXPECT_EQ(runJson()["status"], "interrupted");
  const std::string whole = program() +
                            " & until [ -s out/frames.csv ]; do sleep .005; done; "
                            "kill -HUP $!; wait $!; echo $?";
  EXPECT_EQ(shell("trap '' HUP; rm -r out; " + whole).out, "0\n");
  EXPECT_EQ(runJson()["status"], "tracked");
}

TEST_F(EndedRuns, SecondRunLeavesTheFolderToTheFirst) {
  const ProgramResult result =
      shell(haltedRun() + program() + "; echo $?; kill -CONT $!; wait $!; echo $?");
  EXPECT_EQ(result.out, "1\n0\n");
  EXPECT_EQ(
      result.err,
      "dso_dataset: error: output folder " + out().string() + ": another run writes into it\n");
  EXPECT_EQ(runJson()["status"], "tracked");
  expectReadable();
}

}  // namespace
}  // namespace dsorb
