// SPDX-License-Identifier: BSD-3-Clause
// The program itself, run as a user would on a small rendered sequence.
#include "support/dso_dataset_run.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <fstream>

namespace dsorb {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::Not;
using Json = nlohmann::json;

std::vector<fs::path> imagesOf(const fs::path& sequence) {
  std::vector<fs::path> images;
  for (const auto& entry : fs::directory_iterator(sequence / "images")) {
    images.push_back(entry.path());
  }
  std::sort(images.begin(), images.end());
  return images;
}

void expectOneLine(const std::string& text) {
  EXPECT_EQ(std::count(text.begin(), text.end(), '\n'), 1) << text;
}

TEST_F(DsoDataset, TracksTheRoomAndWritesEveryFile) {
  const ProgramResult result = runOn(room_);
  EXPECT_EQ(result.exit_code, 0) << result.err;
  EXPECT_EQ(result.err, "");
  EXPECT_EQ(result.out, "");
  for (const char* name : {"trajectory.txt",
                           "keyframes.txt",
                           "trajectory_kitti.txt",
                           "initialization.json",
                           "frames.csv",
                           "points.ply",
                           "run.json",
                           "config.yaml",
                           "figures/initial_inverse_depth.png",
                           "figures/trajectory.png"}) {
    EXPECT_GT(readText(file(name)).size(), 0U) << name;
  }
  EXPECT_EQ(readTextLines(file("frames.csv")).size(), kFrames + 1U);
  const Json json = runJson();
  EXPECT_EQ(json["status"], "tracked");
  EXPECT_EQ(json["segments"], 1);
  EXPECT_EQ(json["frames_given"], kFrames);
  const Json starts = Json::parse(readText(file("initialization.json")))["initializations"];
  ASSERT_EQ(starts.size(), 1U);
  const int before_reference = starts[0]["reference"]["index"];
  EXPECT_EQ(readTextLines(file("trajectory.txt")).size(),
            static_cast<std::size_t>(kFrames - before_reference));
}

TEST_F(DsoDataset, SameInputGivesSameBytesForAnyNumberOfThreads) {
  std::vector<std::string> trajectories;
  std::vector<std::string> starts;
  for (const char* threads : {"1", "1", "2"}) {
    ASSERT_EQ(runOn(room_, {"--threads", threads}).exit_code, 0);
    trajectories.push_back(readText(file("trajectory.txt")));
    starts.push_back(initializationsWithoutTimes(out()));
  }
  EXPECT_EQ(trajectories[0], trajectories[1]);
  EXPECT_EQ(trajectories[0], trajectories[2]);
  EXPECT_EQ(starts[0], starts[1]);
  EXPECT_EQ(starts[0], starts[2]);
}

TEST_F(DsoDataset, ReversedRunKeepsIndicesAndSortsByTime) {
  const ProgramResult result = runOn(room_, {"--reverse", "--start", "2", "--end", "20"});
  EXPECT_EQ(result.exit_code, 0) << result.err;
  const auto frames = readTextLines(file("frames.csv"));
  ASSERT_EQ(frames.size(), 19U);
  EXPECT_THAT(frames[1], ::testing::StartsWith("19,"));
  EXPECT_THAT(frames[18], ::testing::StartsWith("2,"));
  const auto lines = readTextLines(file("trajectory.txt"));
  for (std::size_t i = 1; i < lines.size(); ++i) {
    EXPECT_LT(std::stod(lines[i - 1]), std::stod(lines[i]));
  }
}

TEST_F(DsoDataset, LegacyArgumentsWork) {
  const ProgramResult result = run({"files=" + (room_ / "images").string(),
                                    "calib=" + (room_ / "camera.txt").string(),
                                    "--initializer=orb-v1",
                                    "preset=0",
                                    "mode=1",
                                    "nogui=1",
                                    "nolog=1"});
  EXPECT_EQ(result.exit_code, 0) << result.err;
  expectOneLine(result.err);
  EXPECT_THAT(result.err, AllOf(HasSubstr("warning"), HasSubstr("nogui=1 nolog=1")));
  const auto lines = readTextLines(folder_.path() / "result.txt");
  EXPECT_GE(lines.size(), 1U);
  EXPECT_EQ(lines, readTextLines(folder_.path() / "out" / "images" / "keyframes.txt"));
}

TEST_F(DsoDataset, PrintedConfigurationReadsBackTheSame) {
  const ProgramResult printed = run({"--print-config", "--set", "orb.min_frames=7"});
  EXPECT_EQ(printed.exit_code, 0);
  EXPECT_THAT(printed.out, HasSubstr("min_frames: 7"));
  std::ofstream(folder_.path() / "printed.yaml") << printed.out;
  EXPECT_EQ(run({"--print-config", "--config", "printed.yaml"}).out, printed.out);
  EXPECT_EQ(
      run({"--print-config", "--config", "printed.yaml", "--initializer", "orb-v1"}).exit_code, 0);
}

TEST_F(DsoDataset, PhotometryDecidesAboutBrightnessUnlessItIsSet) {
  EXPECT_THAT(run({"--print-config", "--mode", "perfect"}).out, HasSubstr("brightness: perfect"));
  EXPECT_THAT(run({"--print-config", "--mode", "perfect", "--set", "brightness=calibrated"}).out,
              HasSubstr("brightness: calibrated"));
  ASSERT_EQ(runOn(room_, {"--end", "1", "--mode", "perfect"}).exit_code, 3);
  EXPECT_THAT(readText(file("config.yaml")), HasSubstr("brightness: perfect"));
}

TEST_F(DsoDataset, VersionAndHelp) {
  const ProgramResult version = run({"--version"});
  EXPECT_EQ(version.exit_code, 0);
  EXPECT_EQ(version.out, std::string("dso_dataset ") + DSORB_VERSION + "\n");
  const ProgramResult help = run({"--help"});
  EXPECT_EQ(help.exit_code, 0);
  EXPECT_THAT(help.out, HasSubstr("--initializer"));
}

TEST_F(DsoDataset, WrongOptionsExitWithTwoAndOneLine) {
  std::ofstream(folder_.path() / "typo.yaml") << "initializer:\n  orb:\n    min_frame: 6\n";
  const std::string room = room_.string();
  const std::vector<std::pair<std::vector<std::string>, std::string>> cases = {
      {{room, "--initialiser", "orb"}, "'--initializer'"},
      {{room, "--config", "typo.yaml"}, "typo.yaml:3: unknown key 'initializer.orb.min_frame'"},
      {{room, "--set", "num_thread=1"}, "'num_threads'"},
      {{room, "--set", "num_threads=-1"}, "[0, 1024]"},
      {{room, "--preset", "fastest"}, "this version lacks it"},
      {{room, "--speed", "-1"}, "--speed"},
      {{room, "--record"}, "--record"},
      {{"files=" + room, "colour=1"}, "unknown word"},
      {{}, "no data set given"}};
  for (const auto& [arguments, expected] : cases) {
    const ProgramResult result = run(arguments);
    EXPECT_EQ(result.exit_code, 2) << expected;
    EXPECT_THAT(result.err, HasSubstr(expected));
    expectOneLine(result.err);
  }
}

TEST_F(DsoDataset, MissingOrEmptyDataSetIsARuntimeError) {
  const ProgramResult missing = runOn(folder_.path() / "nowhere");
  EXPECT_EQ(missing.exit_code, 1);
  EXPECT_THAT(missing.err, HasSubstr("nowhere"));
  expectOneLine(missing.err);
  EXPECT_EQ(runJson()["status"], "error");
  fs::create_directory(folder_.path() / "empty");
  const ProgramResult empty = runOn(folder_.path() / "empty");
  EXPECT_EQ(empty.exit_code, 1);
  EXPECT_THAT(empty.err, HasSubstr("empty"));
  expectOneLine(empty.err);
}

TEST_F(DsoDataset, TruncatedImageEndsTheRunAfterWriting) {
  const fs::path copy = copyOfRoom();
  const fs::path image = imagesOf(copy)[20];
  fs::resize_file(image, fs::file_size(image) / 2);
  const ProgramResult result = runOn(copy);
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_THAT(result.err, HasSubstr(image.filename().string()));
  expectOneLine(result.err);
  EXPECT_EQ(runJson()["status"], "error");
  EXPECT_EQ(runJson()["frames_given"], 20);
  EXPECT_EQ(readTextLines(file("frames.csv")).size(), 21U);
  EXPECT_GT(readTextLines(file("trajectory.txt")).size(), 5U);
  EXPECT_THAT(readText(file("points.ply")), HasSubstr("end_header"));
}

TEST_F(DsoDataset, ForeignFileBetweenImagesDoesNotDisturb) {
  const fs::path copy = copyOfRoom();
  std::ofstream(copy / "images" / "Thumbs.db") << "not an image";
  EXPECT_EQ(runOn(copy).exit_code, 0);
  EXPECT_EQ(runJson()["frames_given"], kFrames);
}

TEST_F(DsoDataset, ImageOfAnotherSizeIsARuntimeError) {
  const fs::path small = folder_.path() / "small";
  ASSERT_EQ(runProgram({DSORB_SYNTHESIZE,
                        "room",
                        "--output",
                        small.string(),
                        "--frames",
                        "1",
                        "--width",
                        "160",
                        "--height",
                        "128",
                        "--quiet"},
                       folder_.path())
                .exit_code,
            0);
  const fs::path copy = copyOfRoom();
  fs::copy_file(imagesOf(small)[0], imagesOf(copy)[10], fs::copy_options::overwrite_existing);
  const ProgramResult result = runOn(copy);
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_THAT(result.err, AllOf(HasSubstr("160"), HasSubstr("320")));
  EXPECT_EQ(runJson()["frames_given"], 10);
}

TEST_F(DsoDataset, BadCalibrationIsNamed) {
  for (const char* text : {"Pinhole 100 100 160\n320 240\ncrop\n320 240\n",
                           "Pinhole nan 100 160 120 0\n320 240\ncrop\n320 240\n",
                           "Pinhole -100 100 160 120 0\n320 240\ncrop\n320 240\n"}) {
    std::ofstream(folder_.path() / "bad.txt") << text;
    const ProgramResult result = runOn(room_, {"--calib", (folder_.path() / "bad.txt").string()});
    EXPECT_EQ(result.exit_code, 1) << text;
    EXPECT_THAT(result.err, HasSubstr("bad.txt:1"));
    expectOneLine(result.err);
  }
}

TEST_F(DsoDataset, UnwritableOutputFolderIsNamed) {
  std::ofstream(folder_.path() / "file") << "x";
  const std::string below = (folder_.path() / "file" / "out").string();
  const ProgramResult result = run({room_.string(), "--output", below});
  EXPECT_EQ(result.exit_code, 1);
  EXPECT_THAT(result.err, HasSubstr(below));
  expectOneLine(result.err);
}

TEST_F(DsoDataset, OneImageNeverInitializesAndLeavesValidFiles) {
  const ProgramResult result = runOn(room_, {"--end", "1"});
  EXPECT_EQ(result.exit_code, 3) << result.err;
  EXPECT_EQ(runJson()["status"], "never_initialized");
  EXPECT_EQ(runJson()["segments"], 0);
  EXPECT_TRUE(Json::parse(readText(file("initialization.json")))["initializations"].empty());
  EXPECT_EQ(readTextLines(file("frames.csv")).size(), 2U);
  EXPECT_TRUE(readTextLines(file("trajectory.txt")).empty());
}

TEST_F(DsoDataset, SceneCutStopsOrStartsASecondSegment) {
  const fs::path cut = folder_.path() / "cut";
  ASSERT_EQ(runProgram({DSORB_SYNTHESIZE,
                        "cut",
                        "--output",
                        cut.string(),
                        "--frames",
                        "40",
                        "--width",
                        "320",
                        "--height",
                        "240",
                        "--quiet"},
                       folder_.path())
                .exit_code,
            0);
  const ProgramResult stopped = runOn(cut, {"--on-lost", "stop"});
  EXPECT_EQ(stopped.exit_code, 3);
  EXPECT_EQ(runJson()["status"], "lost");
  EXPECT_EQ(runJson()["segments"], 1);
  EXPECT_THAT(readTextLines(file("frames.csv")).back(), HasSubstr(",lost,"));

  const ProgramResult restarted = runOn(cut);
  EXPECT_EQ(runJson()["frames_given"], 40);
  EXPECT_GE(runJson()["segments"], 2);
  EXPECT_GT(readTextLines(file("trajectory_1.txt")).size(), 1U);
  EXPECT_EQ(restarted.exit_code, runJson()["status"] == "tracked" ? 0 : 3);
}

TEST_F(DsoDataset, InterruptWritesWhatWasComputed) {
  const fs::path table = file("frames.csv");
  const ProgramResult result = run({room_.string(), "--output", out().string()},
                                   [&table] { return readTextLines(table).size() > 4; });
  EXPECT_TRUE(result.exit_code == 0 || result.exit_code == 3) << result.exit_code;
  EXPECT_EQ(runJson()["status"], "interrupted");
  EXPECT_LT(runJson()["frames_given"], kFrames);
  EXPECT_EQ(readTextLines(table).size(), runJson()["frames_given"].get<std::size_t>() + 1);
  EXPECT_THAT(readText(file("figures/trajectory.png")), Not(""));
  EXPECT_THAT(result.out, HasSubstr("interrupted"));
}

TEST_F(DsoDataset, NothingOfAnEarlierRunRemains) {
  ASSERT_EQ(runOn(room_).exit_code, 0);
  std::ofstream(file("trajectory_7.txt")) << "old";
  ASSERT_EQ(runOn(room_, {"--end", "1"}).exit_code, 3);
  EXPECT_FALSE(fs::exists(file("trajectory_7.txt")));
  EXPECT_FALSE(fs::exists(file("trajectory_kitti.txt")));
  EXPECT_FALSE(fs::exists(file("figures/initial_inverse_depth.png")));
}

TEST_F(DsoDataset, EffectiveConfigurationLiesBesideTheResult) {
  ASSERT_EQ(runOn(room_, {"--end", "1", "--set", "initializer.seed=9"}).exit_code, 3);
  const ProgramResult printed = run({"--print-config", "--config", file("config.yaml").string()});
  EXPECT_EQ(printed.out, readText(file("config.yaml")));
  EXPECT_THAT(printed.out, HasSubstr("seed: 9"));
}

}  // namespace
}  // namespace dsorb
