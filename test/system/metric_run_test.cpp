// SPDX-License-Identifier: BSD-3-Clause
// Depths beside the images: the program tells the segment in metres.
#include "support/dso_dataset_run.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
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

/// By time in milliseconds.
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
  EXPECT_NEAR(scaleOf(out(), room_), 1, .01);
  const auto start =
      nlohmann::json::parse(readText(out() / "initialization.json"))["initializations"][0];
  EXPECT_GT(start["metric"]["metres_per_unit"], 1.5);  // else the unit would show nothing

  const ProgramResult without = run({room_.string(), "--output", out().string(), "--quiet"});
  ASSERT_EQ(without.exit_code, 0) << without.err;
  const auto free = nlohmann::json::parse(readText(out() / "run.json"));
  ASSERT_EQ(free["units"].size(), 1U) << free.dump(1);
  EXPECT_EQ(free["units"][0]["unit"], "free");
  EXPECT_LT(scaleOf(out(), room_), .7);
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
