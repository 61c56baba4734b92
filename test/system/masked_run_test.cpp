// SPDX-License-Identifier: BSD-3-Clause
// --mask: what the file hides is not used.
#include "support/dso_dataset_run.h"

#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include <filesystem>
#include <string>

namespace dsorb {
namespace {

constexpr int kHiddenFrom = 200;  // [px] column

cv::Mat hidden(cv::Mat& image) {
  return image.colRange(kHiddenFrom, image.cols);
}

TEST_F(DsoDataset, WhatTheMaskHidesIsNotUsed) {
  cv::Mat mask(240, 320, CV_8U, cv::Scalar(255));
  hidden(mask).setTo(0);
  const std::string mask_file = (folder_.path() / "mask.png").string();
  cv::imwrite(mask_file, mask);
  const std::filesystem::path other = copyOfRoom();
  cv::RNG random(1);
  for (const auto& entry : std::filesystem::directory_iterator(other / "images")) {
    cv::Mat image = cv::imread(entry.path().string(), cv::IMREAD_GRAYSCALE);
    random.fill(hidden(image), cv::RNG::UNIFORM, 0, 256);
    cv::imwrite(entry.path().string(), image);
  }

  ASSERT_EQ(runOn(room_, {"--mask", mask_file}).exit_code, 0);
  const std::string trajectory = readText(file("trajectory.txt"));
  const std::string starts = initializationsWithoutTimes(out());
  const nlohmann::json json = nlohmann::json::parse(starts);
  ASSERT_FALSE(json["initializations"].empty());
  for (const nlohmann::json& point : json["initializations"][0]["points"]) {
    ASSERT_LT(point[0].get<double>(), kHiddenFrom);
  }
  ASSERT_EQ(runOn(other, {"--mask", mask_file}).exit_code, 0);
  EXPECT_EQ(readText(file("trajectory.txt")), trajectory);
  EXPECT_EQ(initializationsWithoutTimes(out()), starts);
  runOn(other);
  EXPECT_NE(readText(file("trajectory.txt")), trajectory) << "without the mask it matters";
}

}  // namespace
}  // namespace dsorb
