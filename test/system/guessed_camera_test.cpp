// SPDX-License-Identifier: BSD-3-Clause
// A field of view that is a guess: the window finds the focal length and leaves a calibration.
#include "dsorb/camera/pinhole_camera.h"

#include "estimate/radial.h"
#include "support/run_program.h"
#include "support/temporary_folder.h"
#include "support/text_files.h"

#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>
#include <opencv2/imgproc.hpp>

#include <cmath>
#include <filesystem>
#include <sstream>
#include <string>
#include <vector>

namespace dsorb {
namespace {

/// Of a camera.txt: "Pinhole fx fy cx cy 0", then the size.
struct Camera {
  double fx = 0;
  int width = 0;

  explicit Camera(const std::string& file) {
    std::istringstream stream(readText(file));
    std::string model;
    double fy = 0, cx = 0, cy = 0, omega = 0;
    stream >> model >> fx >> fy >> cx >> cy >> omega >> width;
    EXPECT_TRUE(stream && model == "Pinhole") << file;
  }
};

nlohmann::json runOn(const std::string& room, const std::vector<std::string>& more) {
  std::vector<std::string> words = {DSORB_DATASET, room, "--output", room + "-out", "--quiet"};
  words.insert(words.end(), more.begin(), more.end());
  const ProgramResult run = runProgram(words, std::filesystem::path(room).parent_path());
  EXPECT_EQ(run.exit_code, 0) << run.err;
  return nlohmann::json::parse(readText(room + "-out/run.json"));
}

TEST(GuessedCamera, EndsWithinAPercentAndIsTheCalibrationOfTheNextRun) {
  const TemporaryFolder folder;
  const std::string room = (folder.path() / "room").string();
  const ProgramResult made = runProgram(
      {DSORB_SYNTHESIZE, "room", "--output", room, "--frames", "90", "--quiet"}, folder.path());
  ASSERT_EQ(made.exit_code, 0) << made.err;
  const Camera truth(room + "/camera.txt");
  for (const double error : {-0.1, 0.1}) {
    const double half = std::atan(0.5 * truth.width / (truth.fx * (1 + error)));
    const auto guessed = runOn(room, {"--hfov", std::to_string(2 * half * 180 / M_PI)});
    ASSERT_TRUE(guessed.contains("refined_camera")) << guessed.dump(2);
    const auto& refined = guessed["refined_camera"];
    EXPECT_NEAR(refined["fx"].get<double>() / truth.fx, 1, 0.01) << error;
    EXPECT_NEAR(refined["fy"].get<double>() / truth.fx, 1, 0.01) << error;
    EXPECT_LT(refined["sigma"]["fx"].get<double>() / truth.fx, 0.01);
    EXPECT_EQ(refined["settled"], true) << refined.dump(2);

    const std::string file = (folder.path() / "next.txt").string();
    std::filesystem::copy_file(
        room + "-out/refined_camera.txt", file, std::filesystem::copy_options::overwrite_existing);
    EXPECT_NEAR(Camera(file).fx, refined["fx"].get<double>(), 1e-6);
    const auto next = runOn(room, {"--calib", file});
    EXPECT_FALSE(next.contains("refined_camera")) << "it is a calibration now";
    EXPECT_FALSE(std::filesystem::exists(room + "-out/refined_camera.txt"));
    EXPECT_EQ(next["status"], "tracked");
  }
}

/// Replaces the images of a rendered room by those of a lens with k1 and a focal length that is
/// `longer` times the room's, so that the corners stay inside the rendered ones.
void distort(const std::filesystem::path& room,
             const PinholeCamera& camera,
             float k1,
             float longer) {
  cv::Mat map_x(camera.height, camera.width, CV_32F), map_y = map_x.clone();
  for (int y = 0; y < camera.height; ++y) {
    for (int x = 0; x < camera.width; ++x) {
      const Eigen::Vector2f seen = camera.unproject({x, y}).head<2>().cast<float>() / longer;
      const Eigen::Vector2d at = camera.project(unbend(k1, seen).cast<double>().homogeneous());
      map_x.at<float>(y, x) = static_cast<float>(at.x());
      map_y.at<float>(y, x) = static_cast<float>(at.y());
    }
  }
  for (const auto& file : std::filesystem::directory_iterator(room / "images")) {
    cv::Mat image = cv::imread(file.path().string(), cv::IMREAD_GRAYSCALE), seen;
    cv::remap(image, seen, map_x, map_y, cv::INTER_CUBIC, cv::BORDER_REFLECT);
    ASSERT_TRUE(cv::imwrite(file.path().string(), seen));
  }
}

TEST(GuessedCamera, ARadialDistortionIsFoundAndIsInTheCalibrationOfTheNextRun) {
  const TemporaryFolder folder;
  const std::string room = (folder.path() / "room").string();
  const ProgramResult made = runProgram(
      {DSORB_SYNTHESIZE, "room", "--output", room, "--frames", "90", "--quiet"}, folder.path());
  ASSERT_EQ(made.exit_code, 0) << made.err;
  const double focal = Camera(room + "/camera.txt").fx;
  const PinholeCamera camera{focal, focal, 319.5, 239.5, 640, 480};
  constexpr float kDistortion = -0.15F, kLonger = 1.15F;
  distort(room, camera, kDistortion, kLonger);
  const double truth = static_cast<double>(kLonger) * focal;
  const double half = std::atan(320 / (truth * 0.9));
  const auto refined =
      runOn(room, {"--hfov", std::to_string(2 * half * 180 / M_PI)})["refined_camera"];
  EXPECT_NEAR(refined["fx"].get<double>() / truth, 1, 0.01) << refined.dump(2);
  EXPECT_NEAR(refined["k1"].get<double>(), static_cast<double>(kDistortion), 0.01);
  EXPECT_EQ(refined["settled"], true) << refined.dump(2);
  const std::string file = readText(room + "-out/refined_camera.txt");
  EXPECT_EQ(file.substr(0, 7), "RadTan ") << file;
}

}  // namespace
}  // namespace dsorb
