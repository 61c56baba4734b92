// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "support/run_program.h"
#include "support/temporary_folder.h"
#include "support/text_files.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include <filesystem>
#include <functional>
#include <string>
#include <vector>

namespace dsorb {

constexpr int kFrames = 24;                         // of the room
constexpr double kSecondsBetweenImages = 1.0 / 30;  // in it

/// One rendered room for all tests; each test works in a folder of its own.
class DsoDataset : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    shared_ = new TemporaryFolder();
    room_ = shared_->path() / "room";
    const ProgramResult made = runProgram({DSORB_SYNTHESIZE,
                                           "room",
                                           "--output",
                                           room_.string(),
                                           "--frames",
                                           std::to_string(kFrames),
                                           "--width",
                                           "320",
                                           "--height",
                                           "240",
                                           "--quiet"},
                                          shared_->path());
    ASSERT_EQ(made.exit_code, 0) << made.err;
  }
  static void TearDownTestSuite() {
    delete shared_;
    shared_ = nullptr;
  }

  ProgramResult run(std::vector<std::string> arguments,
                    const std::function<bool()>& interrupt_when = nullptr) const {
    arguments.insert(arguments.begin(), DSORB_DATASET);
    return runProgram(arguments, folder_.path(), interrupt_when);
  }
  /// Runs into the folder "out" of this test.
  ProgramResult runOn(const std::filesystem::path& sequence,
                      std::vector<std::string> more = {}) const {
    more.insert(more.begin(), {sequence.string(), "--output", out().string(), "--quiet"});
    more.insert(more.begin(), {"--initializer", "orb-v1"});  // orb waits longer at this size
    return run(more);
  }
  /// Runs a line of shell in which $dso is the program.
  [[nodiscard]] ProgramResult shell(const std::string& line) const {
    return runProgram({"/bin/bash", "-c", "dso=" DSORB_DATASET "; " + line}, folder_.path());
  }
  /// A copy of the room that a test may spoil.
  [[nodiscard]] std::filesystem::path copyOfRoom() const {
    const std::filesystem::path copy = folder_.path() / "copy";
    std::filesystem::copy(room_, copy, std::filesystem::copy_options::recursive);
    return copy;
  }
  [[nodiscard]] std::filesystem::path out() const { return folder_.path() / "out"; }
  [[nodiscard]] std::filesystem::path file(const std::string& name) const { return out() / name; }
  [[nodiscard]] nlohmann::json runJson() const {
    return nlohmann::json::parse(readText(file("run.json")));
  }
  /// initialization.json without its times, as text.
  [[nodiscard]] static std::string initializationsWithoutTimes(
      const std::filesystem::path& folder) {
    nlohmann::json json = nlohmann::json::parse(readText(folder / "initialization.json"));
    for (nlohmann::json& start : json["initializations"]) start.erase("milliseconds");
    return json.dump();
  }

  static inline TemporaryFolder* shared_ = nullptr;
  static inline std::filesystem::path room_;
  TemporaryFolder folder_;
};

}  // namespace dsorb
