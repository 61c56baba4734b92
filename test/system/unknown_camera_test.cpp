// SPDX-License-Identifier: BSD-3-Clause
// Images and nothing else: the program finds the camera, and runs with it.
#include "support/run_program.h"
#include "support/temporary_folder.h"
#include "support/text_files.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include <cmath>
#include <filesystem>
#include <string>
#include <vector>

namespace dsorb {
namespace {

namespace fs = std::filesystem;

/// A rendered room without its calibration. @param view [degrees]
fs::path roomWithoutCalibration(const fs::path& folder, const std::string& view) {
  const fs::path room = folder / ("room_" + view);
  const ProgramResult made = runProgram({DSORB_SYNTHESIZE,
                                         "room",
                                         "--output",
                                         room.string(),
                                         "--frames",
                                         "70",
                                         "--fov",
                                         view,
                                         "--quiet"},
                                        folder);
  EXPECT_EQ(made.exit_code, 0) << made.err;
  fs::remove(room / "camera.txt");
  return room;
}

nlohmann::json runOn(const fs::path& sequence,
                     const fs::path& output,
                     const std::vector<std::string>& more = {}) {
  std::vector<std::string> words = {DSORB_DATASET, sequence.string(), "--output", output.string()};
  words.insert(words.end(), more.begin(), more.end());
  const ProgramResult run = runProgram(words, output.parent_path());
  EXPECT_EQ(run.exit_code, 0) << run.err;
  EXPECT_NE(run.out.find("focal length "), std::string::npos) << run.out;
  return nlohmann::json::parse(readText(output / "run.json"));
}

TEST(UnknownCamera, IsFoundAndIsACalibrationWhereItIsKnown) {
  const TemporaryFolder folder;
  for (const auto& [view, focal] : {std::pair("50", 686.2), std::pair("90", 320.0)}) {
    const fs::path room = roomWithoutCalibration(folder.path(), view);
    const fs::path out = folder.path() / "out";
    const auto run = runOn(room, out);
    EXPECT_EQ(run["status"], "tracked");
    EXPECT_EQ(run["segments"], 1);
    const auto& found = run["found_camera"];
    EXPECT_NEAR(found["fx"].get<double>() / focal, 1, 0.01) << found.dump(2);
    const double sigma = found["sigma"]["focal"].get<double>();
    EXPECT_LT(std::abs(found["fx"].get<double>() - focal), 2 * sigma) << found.dump(2);
    EXPECT_EQ(run["lens"]["fx"], found["fx"]);
    EXPECT_EQ(found["fy"], found["fx"]);
    EXPECT_FALSE(run.contains("calibration_suspected")) << "of a camera that nobody gave";
    EXPECT_EQ(fs::exists(out / "refined_camera.txt"), found["known"].get<bool>());
  }
}

TEST(UnknownCamera, ImagesMayBeSqueezed) {
  const TemporaryFolder folder;
  const fs::path room = roomWithoutCalibration(folder.path(), "65");
  for (const fs::directory_entry& image : fs::directory_iterator(room / "images")) {
    cv::Mat squeezed;
    cv::resize(cv::imread(image.path().string(), cv::IMREAD_GRAYSCALE),
               squeezed,
               {640, 368},
               0,
               0,
               cv::INTER_AREA);
    ASSERT_TRUE(cv::imwrite(image.path().string(), squeezed));
  }
  const auto found = runOn(room, folder.path() / "out")["found_camera"];
  EXPECT_NEAR(found["fx"].get<double>() / 502.3, 1, 0.01) << found.dump(2);
  EXPECT_NEAR(found["fy"].get<double>() / found["fx"].get<double>(), 368.0 / 480, 0.005);
  EXPECT_FALSE(found["image_shift"]["contradicts_one_camera"].get<bool>());
}

TEST(UnknownCamera, IsNoCalibrationWhereFewImagesTellIt) {
  const TemporaryFolder folder;
  const fs::path room = roomWithoutCalibration(folder.path(), "50");
  const auto run = runOn(room, folder.path() / "out", {"--end", "25"});
  EXPECT_FALSE(run["found_camera"]["known"].get<bool>()) << "measured: 1.9 %";
  EXPECT_FALSE(fs::exists(folder.path() / "out" / "refined_camera.txt"));
}

}  // namespace
}  // namespace dsorb
