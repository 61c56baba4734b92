// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/io/writers.h"

#include "support/fake_run.h"
#include "support/temporary_folder.h"
#include "support/text_files.h"

#include <gtest/gtest.h>

#include <cstddef>
#include <filesystem>
#include <string>
#include <vector>

namespace dsorb {
namespace {

namespace fs = std::filesystem;

TEST(RefinedCamera, SummaryHasTheRefinedCamera) {
  const TemporaryFolder folder;
  FakeRun run(folder.path());
  playOneSegment(run);
  PinholeCamera refined = kCamera;
  refined.fx = 102;
  run.writer.onKeyframe({FrameId{0}, 0, 0, SE3(), {}, refined, {}});
  run.writer.finish(RunStatus::kTracked, nullptr);
  const auto json = readJson(folder.path() / "run.json");
  EXPECT_EQ(json["camera"]["fx"], 100.0);
  EXPECT_EQ(json["refined_camera"]["fx"], 102.0);
}

/// A run whose window ends with these focal lengths, one a keyframe.
/// @param step of the keyframes' ids
void refine(FakeRun& run,
            const std::vector<double>& focal_lengths,
            double sigma,
            int segment = 0,
            int step = 1) {
  for (std::size_t i = 0; i < focal_lengths.size(); ++i) {
    PinholeCamera camera = kCamera;
    camera.fx = camera.fy = focal_lengths[i];
    camera.cx += 1;
    KeyframeSnapshot shot{
        FrameId{100 + step * static_cast<int>(i)}, 0, segment, SE3(), {}, camera, {}};
    shot.camera_sigmas = {{sigma, sigma, 2, 3}};
    run.writer.onKeyframe(shot);
  }
}

TEST(RefinedCamera, RefinedCameraIsTheCalibrationOfTheNextRun) {
  const TemporaryFolder folder;
  FakeRun run(folder.path());
  playOneSegment(run);
  Lens lens;
  lens.fx = lens.fy = 200;  // the run is at half the size
  lens.cx = 159.5;
  lens.cy = 119.5;
  lens.width = 320;
  lens.height = 250;
  lens.readout = {0.025, 0};
  lens.columns = lens.backwards = true;
  run.writer.setCamera(kCamera, &lens);
  refine(run, {102, 108, 110, 110.2, 110.4}, 0.5);
  refine(run, {100, 100}, 5, 1);  // knows less
  run.writer.finish(RunStatus::kTracked, nullptr);
  const auto refined = readJson(folder.path() / "run.json")["refined_camera"];
  EXPECT_EQ(refined["fx"], 110.4);
  EXPECT_EQ(refined["sigma"]["fx"], 0.5);
  EXPECT_EQ(refined["sigma"]["cy"], 3.0);
  EXPECT_NEAR(refined["moved"], 0.2 / 110.4, 1e-9) << "in the last third";
  EXPECT_EQ(refined["settled"], true);
  const auto lines = readTextLines(folder.path() / "refined_camera.txt");
  ASSERT_EQ(lines.size(), 5U);
  EXPECT_EQ(lines[4], "readout -25 columns");
  EXPECT_EQ(lines[0], "Pinhole 220.8 220.8 161.5 119.5 0");
  EXPECT_EQ(lines[1], "320 250");
}

TEST(RefinedCamera, ADistortionThatShowsIsPartOfTheNextCalibration) {
  for (const double k1 : {-0.1, 0.02}) {
    const TemporaryFolder folder;
    FakeRun run(folder.path());
    playOneSegment(run);
    Lens lens;
    lens.fx = lens.fy = 100;
    lens.width = 160;
    lens.height = 120;
    run.writer.setCamera(kCamera, &lens);
    PinholeCamera camera = kCamera;
    camera.fx += 1;
    KeyframeSnapshot shot{FrameId{0}, 0, 0, SE3(), {}, camera, {}};
    shot.camera_sigmas = {{0.4, 0.4, 2, 3}};
    shot.radial = {k1, 0.01};
    run.writer.onKeyframe(shot);
    run.writer.finish(RunStatus::kTracked, nullptr);
    const auto refined = readJson(folder.path() / "run.json")["refined_camera"];
    EXPECT_EQ(refined["k1"], k1);
    EXPECT_EQ(refined["sigma"]["k1"], 0.01);
    const std::string line = readTextLines(folder.path() / "refined_camera.txt").at(0);
    EXPECT_EQ(line.substr(0, 7), k1 < 0 ? "RadTan " : "Pinhole") << line;
  }
}

TEST(RefinedCamera, AFocalLengthThatStillMovesIsNoCalibration) {
  for (const double sigma : {0.5, 2.0}) {
    const TemporaryFolder folder;
    FakeRun run(folder.path());
    playOneSegment(run);
    const Lens lens;
    run.writer.setCamera(kCamera, &lens);
    refine(run,
           sigma < 1 ? std::vector<double>{102, 104, 106, 110} : std::vector<double>{104, 104},
           sigma);
    run.writer.finish(RunStatus::kTracked, nullptr);
    EXPECT_EQ(readJson(folder.path() / "run.json")["refined_camera"]["settled"], false);
    EXPECT_FALSE(fs::exists(folder.path() / "refined_camera.txt"));
  }
}

TEST(RefinedCamera, OfAFoundCameraIsNoSurerThanWhatWasFound) {
  for (const double sigma : {0.005, 0.02}) {
    const TemporaryFolder folder;
    FakeRun run(folder.path());
    playOneSegment(run);
    FoundCamera found;
    found.lens.width = 160;
    found.lens.height = 120;
    found.lens.fx = found.lens.fy = 100;
    found.lens.focal_sigma = sigma;
    run.writer.setCamera(kCamera, &found.lens);
    run.writer.setFoundCamera(found);
    refine(run, {102, 102, 102}, 0.1);
    run.writer.finish(RunStatus::kTracked, nullptr);
    const auto json = readJson(folder.path() / "run.json");
    EXPECT_EQ(json["refined_camera"]["settled"], sigma < 0.01);
    EXPECT_EQ(json["found_camera"]["known"], sigma < 0.01);
    EXPECT_FALSE(json["found_camera"].contains("focal_change")) << "not known";
    EXPECT_EQ(fs::exists(folder.path() / "refined_camera.txt"), sigma < 0.01);
  }
}

TEST(RefinedCamera, MovesAsFarInAReversedRun) {
  for (const int step : {1, -1}) {
    const TemporaryFolder folder;
    FakeRun run(folder.path());
    playOneSegment(run);
    refine(run, {102, 104, 106, 110}, 0.5, 1, step);
    run.writer.finish(RunStatus::kTracked, nullptr);
    EXPECT_NEAR(readJson(folder.path() / "run.json")["refined_camera"]["moved"], 4 / 110., 1e-9)
        << step;
  }
}

}  // namespace
}  // namespace dsorb
