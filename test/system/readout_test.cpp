// SPDX-License-Identifier: BSD-3-Clause
// The readout of a rolling shutter, estimated from the images.
#include "support/real_data.h"
#include "support/run_program.h"
#include "support/temporary_folder.h"
#include "support/text_files.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <cmath>
#include <filesystem>
#include <string>
#include <vector>

namespace dsorb {
namespace {

struct Found {
  double milliseconds = 0;
  double sigma = 0;
};

/// Estimate at the end of a rendered hand-held sequence.
Found foundIn(const TemporaryFolder& folder, const std::string& readout_ms) {
  const std::string room = (folder.path() / readout_ms).string();
  const ProgramResult made = runProgram({DSORB_SYNTHESIZE,
                                         "room",
                                         "--output",
                                         room,
                                         "--frames",
                                         "90",
                                         "--readout=" + readout_ms,
                                         "--quiet"},
                                        folder.path());
  EXPECT_EQ(made.exit_code, 0) << made.err;
  const ProgramResult run =
      runProgram({DSORB_DATASET, room, "--output", room + "-out", "--readout", "auto", "--quiet"},
                 folder.path());
  EXPECT_EQ(run.exit_code, 0) << run.err;
  const auto json = nlohmann::json::parse(readText(room + "-out/run.json"));
  if (!json.contains("readout")) {
    ADD_FAILURE() << json.dump(2);
    return {};
  }
  return {json["readout"]["milliseconds"], json["readout"]["sigma"]};
}

TEST(Readout, IsFoundFromTheImages) {
  const TemporaryFolder folder;
  for (const double truth : {20.0, -12.0, 0.0}) {
    const Found found = foundIn(folder, std::to_string(truth));
    // Measured: errors .4, .3 and .5, sigma .7 ms.
    EXPECT_LT(std::abs(found.milliseconds - truth), 1.5) << truth;
    EXPECT_LT(std::abs(found.milliseconds - truth), 3 * found.sigma) << truth;
    EXPECT_LT(found.sigma, 1.5) << truth;
  }
}

TEST(Readout, IsSaidNotToBeModelledByTheStartsThatDoNot) {
  const TemporaryFolder folder;
  const std::string room = (folder.path() / "room").string();
  const std::vector<std::string> small{"--frames", "4", "--width", "160", "--height", "128"};
  std::vector<std::string> render{DSORB_SYNTHESIZE, "room", "--output", room, "--quiet"};
  render.insert(render.end(), small.begin(), small.end());
  ASSERT_EQ(runProgram(render, folder.path()).exit_code, 0);
  const auto says = [&](const std::string& initializer, const std::string& readout) {
    const std::vector<std::string> run{DSORB_DATASET,
                                       room,
                                       "--output",
                                       room + "-out",
                                       "--initializer",
                                       initializer,
                                       "--readout",
                                       readout};
    return runProgram(run, folder.path()).err.find("as if all rows were read at once") !=
           std::string::npos;
  };
  EXPECT_TRUE(says("coarse", "20"));
  EXPECT_TRUE(says("coarse", "auto"));
  EXPECT_FALSE(says("coarse", "0"));
  EXPECT_FALSE(says("orb", "20"));
}

/// What a run without a word about the readout says of it.
nlohmann::json suspicionOn(const std::string& sequence, const TemporaryFolder& folder) {
  const std::string out = (folder.path() / sequence).string();
  const ProgramResult run = runProgram(
      {DSORB_DATASET, realData(sequence).string(), "--end", "30", "--output", out, "--quiet"},
      folder.path());
  EXPECT_EQ(run.exit_code, 0) << run.err;
  return nlohmann::json::parse(readText(out + "/run.json"))
      .value("rolling_shutter_suspected", nlohmann::json());
}

TEST(Readout, IsSuspectedWhereItShows) {
  for (const char* sequence : {"room_rolling", "room_hand"}) {
    if (!std::filesystem::exists(realData(sequence))) GTEST_SKIP() << realData(sequence);
  }
  const TemporaryFolder folder;
  const nlohmann::json found = suspicionOn("room_rolling", folder);
  ASSERT_TRUE(found.is_object());
  // Measured: 9.5 ms of 25, 3.2 sigma; room_hand .3 ms, below 1.4 sigma.
  EXPECT_GT(found["milliseconds"], 5);
  EXPECT_LT(found["milliseconds"], 40);
  EXPECT_TRUE(suspicionOn("room_hand", folder).is_null());
}

}  // namespace
}  // namespace dsorb
