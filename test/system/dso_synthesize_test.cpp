// SPDX-License-Identifier: BSD-3-Clause
#include "support/temporary_folder.h"

#include <gmock/gmock.h>
#include <sys/wait.h>

#include <array>
#include <filesystem>
#include <string>

namespace dsorb {
namespace {

namespace fs = std::filesystem;

struct ProgramRun {
  int exit_code = -1;
  std::string output;  ///< both streams
};

ProgramRun synthesize(const std::string& arguments) {
  const std::string command = std::string("'" DSORB_SYNTHESIZE "' ") + arguments + " 2>&1";
  FILE* pipe = popen(command.c_str(), "r");
  ProgramRun run;
  std::array<char, 512> buffer{};
  while (fgets(buffer.data(), static_cast<int>(buffer.size()), pipe) != nullptr) {
    run.output += buffer.data();
  }
  const int status = pclose(pipe);
  run.exit_code = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
  return run;
}

constexpr const char* kSmall = " --width 96 --height 64 --frames 3 ";

std::string quoted(const fs::path& path) {
  return "'" + path.string() + "'";
}

TEST(DsoSynthesize, WritesEveryKind) {
  const TemporaryFolder folder;
  for (const char* kind : {"street", "room", "plane", "static", "rotation", "cut"}) {
    const fs::path dataset = folder.path() / kind;
    const ProgramRun run = synthesize(kind + std::string(kSmall) + "--output " + quoted(dataset));
    EXPECT_EQ(run.exit_code, 0) << run.output;
    EXPECT_THAT(run.output, testing::EndsWith(": 3 of 3 frames\n"));
    EXPECT_THAT(run.output, testing::Not(testing::HasSubstr("2 of 3"))) << "no terminal, one line";
    for (const char* file : {"images/00002.png",
                             "depth/00000.png",
                             "times.txt",
                             "camera.txt",
                             "groundtruth.txt",
                             "../sequences.json"}) {
      EXPECT_TRUE(fs::exists(dataset / file)) << kind << ' ' << file;
    }
    EXPECT_FALSE(fs::exists(dataset / "pcalib.txt"));
  }
}

TEST(DsoSynthesize, WritesPhotometricFilesWithThePhotometricOptions) {
  const TemporaryFolder folder;
  const fs::path dataset = folder.path() / "x";
  const ProgramRun run = synthesize(
      "room --exposure-changes --vignette --blur --moving-object --supersampling 2 "
      "--fov 90 --seed 4 --noise 2 --threads 2 --quiet -o " +
      quoted(dataset) + kSmall);
  EXPECT_EQ(run.exit_code, 0);
  EXPECT_EQ(run.output, "");
  EXPECT_TRUE(fs::exists(dataset / "pcalib.txt"));
  EXPECT_TRUE(fs::exists(dataset / "vignette.png"));
}

TEST(DsoSynthesize, HelpsWithWrongOptions) {
  const TemporaryFolder folder;
  const std::string output = " --output " + quoted(folder.path() / "x");
  const auto expectUsage = [&](const std::string& arguments, const char* help) {
    const ProgramRun run = synthesize(arguments);
    EXPECT_EQ(run.exit_code, 2) << arguments;
    EXPECT_THAT(run.output, testing::HasSubstr(help)) << arguments;
  };
  expectUsage("stret" + output, "street");
  expectUsage("street --widht 320" + output, "--widht");
  expectUsage("street --frames 0" + output, "--frames");
  expectUsage("street --noise many" + output, "--noise");
  expectUsage("street", "--output");
  expectUsage("--output x", "KIND");
  EXPECT_FALSE(fs::exists(folder.path() / "x"));
}

TEST(DsoSynthesize, NamesTheFolderItCannotWrite) {
  const ProgramRun run = synthesize("room --frames 1 --quiet --output /dev/null/x");
  EXPECT_EQ(run.exit_code, 1);
  EXPECT_THAT(run.output, testing::HasSubstr("/dev/null/x"));
}

TEST(DsoSynthesize, TellsHelpAndVersion) {
  const ProgramRun help = synthesize("--help");
  EXPECT_EQ(help.exit_code, 0);
  EXPECT_THAT(help.output, testing::HasSubstr("--moving-object"));
  const ProgramRun version = synthesize("--version");
  EXPECT_EQ(version.exit_code, 0);
  EXPECT_THAT(version.output, testing::StartsWith("dso_synthesize "));
}

}  // namespace
}  // namespace dsorb
