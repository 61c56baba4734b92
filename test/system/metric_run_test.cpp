// SPDX-License-Identifier: BSD-3-Clause
// Depths beside the images: the program tells the segment in metres.
#include "support/dso_dataset_run.h"

#include <gtest/gtest.h>
#include <opencv2/imgcodecs.hpp>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <map>
#include <sstream>
#include <string>
#include <vector>

namespace dsorb {
namespace {

struct Position {
  double x = 0, y = 0, z = 0;
};

double distance(const Position& a, const Position& b) {
  return std::sqrt((a.x - b.x) * (a.x - b.x) + (a.y - b.y) * (a.y - b.y) +
                   (a.z - b.z) * (a.z - b.z));
}

/// Positions of a trajectory, by time in milliseconds.
std::map<long, Position> positionsOf(const std::filesystem::path& file) {
  std::map<long, Position> positions;
  std::ifstream stream(file);
  for (std::string line; std::getline(stream, line);) {
    std::istringstream words(line);
    double time = 0;
    Position p;
    if (words >> time >> p.x >> p.y >> p.z) positions[std::lround(1000 * time)] = p;
  }
  return positions;
}

/// Way from the first to the last tracked frame over the true one.
double scaleOf(const std::filesystem::path& run, const std::filesystem::path& sequence) {
  const auto found = positionsOf(run / "trajectory.txt");
  const auto truth = positionsOf(sequence / "groundtruth.txt");
  if (found.size() < 10) return NAN;
  const long first = found.begin()->first;
  const long last = found.rbegin()->first;
  return distance(found.at(first), found.at(last)) / distance(truth.at(first), truth.at(last));
}

/// Depth of points.ply over the true one in the start's reference, which is the world: median.
double depthRatio(const std::filesystem::path& run, const std::filesystem::path& sequence) {
  const auto json = nlohmann::json::parse(readText(run / "initialization.json"));
  const nlohmann::json& start = json["initializations"][0];
  const nlohmann::json& camera = start["camera"];
  const std::filesystem::path times = sequence / "times.txt";
  const std::string name = readTextLines(times)[start["reference"]["index"].get<std::size_t>()];
  const std::string image = name.substr(0, name.find(' ')) + ".png";
  const cv::Mat depth = cv::imread((sequence / "depth" / image).string(), cv::IMREAD_UNCHANGED);
  const std::string text = readText(run / "points.ply");
  constexpr std::size_t kVertexBytes = 27;
  std::vector<double> ratios;
  for (std::size_t at = text.find("end_header\n") + 11; at + kVertexBytes <= text.size();
       at += kVertexBytes) {
    float p[3];
    std::memcpy(p, text.data() + at, sizeof(p));
    const double z = p[2];
    const long x = std::lround(camera["fx"].get<double>() * p[0] / z + camera["cx"].get<double>());
    const long y = std::lround(camera["fy"].get<double>() * p[1] / z + camera["cy"].get<double>());
    if (!(z > 0) || x < 0 || y < 0 || x >= depth.cols || y >= depth.rows) continue;
    const int millimetres = depth.at<std::uint16_t>(static_cast<int>(y), static_cast<int>(x));
    if (millimetres > 0) ratios.push_back(1000 * z / millimetres);
  }
  if (ratios.size() < 100) return NAN;
  std::sort(ratios.begin(), ratios.end());
  return ratios[ratios.size() / 2];
}

class MetricRun : public DsoDataset {};

TEST_F(MetricRun, IsInMetresWithDepthsAndFreeWithout) {
  const ProgramResult with =
      run({room_.string(), "--output", out().string(), "--quiet", "--use-depth", "0.01"});
  ASSERT_EQ(with.exit_code, 0) << with.err;
  const auto json = nlohmann::json::parse(readText(out() / "run.json"));
  ASSERT_EQ(json["units"].size(), 1U) << json.dump(1);
  EXPECT_EQ(json["units"][0]["unit"], "metre");
  EXPECT_EQ(json["units"][0]["segment"], 0);
  EXPECT_GT(json["units"][0]["relative_sigma"], 0);
  EXPECT_LT(json["units"][0]["relative_sigma"], .02);
  // Rooms of seeds 1 to 3: path .05, .17 and .28 % off, points .15 % at most.
  EXPECT_NEAR(scaleOf(out(), room_), 1, .01);
  EXPECT_NEAR(depthRatio(out(), room_), 1, .01);
  const auto start =
      nlohmann::json::parse(readText(out() / "initialization.json"))["initializations"][0];
  EXPECT_GT(start["metric"]["metres_per_unit"], 1.5);  // else the unit would show nothing

  const ProgramResult without = run({room_.string(), "--output", out().string(), "--quiet"});
  ASSERT_EQ(without.exit_code, 0) << without.err;
  const auto free = nlohmann::json::parse(readText(out() / "run.json"));
  ASSERT_EQ(free["units"].size(), 1U) << free.dump(1);
  EXPECT_EQ(free["units"][0]["unit"], "free");
  EXPECT_LT(scaleOf(out(), room_), .7);  // those rooms: .29 to .41
  EXPECT_LT(depthRatio(out(), room_), .7);
}

TEST_F(MetricRun, AnImpossibleDeviationAndMissingDepthsAreNamed) {
  EXPECT_EQ(
      run({room_.string(), "--output", out().string(), "--quiet", "--use-depth", "-1"}).exit_code,
      2);
  const std::filesystem::path bare = out().parent_path() / "bare";
  std::filesystem::copy(room_, bare, std::filesystem::copy_options::recursive);
  std::filesystem::remove_all(bare / "depth");
  const ProgramResult missing =
      run({bare.string(), "--output", out().string(), "--quiet", "--use-depth", "0.01"});
  EXPECT_EQ(missing.exit_code, 1) << missing.err;
  EXPECT_NE(missing.err.find("depth"), std::string::npos) << missing.err;
}

}  // namespace
}  // namespace dsorb
