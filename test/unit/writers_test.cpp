// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/io/writers.h"

#include "io/output/figures.h"
#include "support/fake_run.h"
#include "support/temporary_folder.h"
#include "support/text_files.h"

#include <gmock/gmock.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <utility>
#include <vector>

namespace dsorb {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::StartsWith;

TEST(RunWriter, TrajectoryHoldsInitializationAndTrackedFrames) {
  const TemporaryFolder folder;
  FakeRun run(folder.path());
  playOneSegment(run);
  const auto lines = readTextLines(folder.path() / "trajectory.txt");
  ASSERT_EQ(lines.size(), 5U) << "grows while the run goes on";
  EXPECT_EQ(lines[3],
            "0.300000000 0.000000000 0.000000000 0.300000000 0.000000000 0.000000000 0.000000000 "
            "1.000000000");
  run.writer.finish(run.writer.outcome(), nullptr);
  EXPECT_EQ(readTextLines(folder.path() / "trajectory.txt"), lines);
  EXPECT_EQ(readTextLines(folder.path() / "keyframes.txt").size(), 1U);
  const auto kitti = readTextLines(folder.path() / "trajectory_kitti.txt");
  ASSERT_EQ(kitti.size(), 5U);
  EXPECT_THAT(kitti[4], StartsWith("1.000000000e+00 0.000000000e+00"));
  EXPECT_FALSE(fs::exists(folder.path() / "trajectory_0.txt"));
}

TEST(RunWriter, FinalFramesFollowTheNextKeyframeToo) {
  const TemporaryFolder folder;
  FakeRun run(folder.path());
  playOneSegment(run);
  run.trackedKeyframe(5, translated(0.7));  // tracked at 0.5
  run.tracked(6);                           // still against the first one, as when pipelined
  run.writer.finish(run.writer.outcome(), nullptr);
  const auto lines = readTextLines(folder.path() / "trajectory.txt");
  ASSERT_EQ(lines.size(), 7U);
  EXPECT_THAT(lines[3], StartsWith("0.300000000 0.000000000 0.000000000 0.420000000"));
  EXPECT_THAT(lines[4], StartsWith("0.400000000 0.000000000 0.000000000 0.560000000"));
  EXPECT_THAT(lines[5], StartsWith("0.500000000 0.000000000 0.000000000 0.700000000"));
  EXPECT_THAT(lines[6], StartsWith("0.600000000 0.000000000 0.000000000 0.800000000"));
}

TEST(RunWriter, FinalFramesFollowTheirKeyframe) {
  const TemporaryFolder folder;
  FakeRun run(folder.path());
  playOneSegment(run);
  run.keyframe(translated(10));  // the keyframe moved after all
  run.writer.finish(run.writer.outcome(), nullptr);
  const auto lines = readTextLines(folder.path() / "trajectory.txt");
  EXPECT_THAT(lines[0], StartsWith("0.000000000 0.000000000 0.000000000 10.000000000"));
  EXPECT_THAT(lines[4], StartsWith("0.400000000 0.000000000 0.000000000 10.400000000"));
}

TEST(RunWriter, FramesOfTheInitializationFollowItsTwoEnds) {
  const TemporaryFolder folder;
  FakeRun run(folder.path());
  playOneSegment(run);
  KeyframeSnapshot newest;
  newest.id = {2};
  newest.timestamp = 0.2;
  newest.T_world_cam = translated(0.3);  // the initializer had said 0.2
  run.writer.onKeyframe(newest);
  run.writer.finish(run.writer.outcome(), nullptr);
  const auto lines = readTextLines(folder.path() / "trajectory.txt");
  EXPECT_THAT(lines[1], StartsWith("0.100000000 0.000000000 0.000000000 0.150000000"));
  EXPECT_THAT(lines[2], StartsWith("0.200000000 0.000000000 0.000000000 0.300000000"));
}

TEST(RunWriter, RepeatedImagesOfTheInitializationHaveThePosesOfTheFirstOnes) {
  const TemporaryFolder folder;
  FakeRun run(folder.path());
  run.initializing(0);
  run.repeated(1, 0);
  run.initializing(2);
  run.repeated(3, 2);
  run.repeated(4, 2);
  run.initialized(5);
  run.writer.finish(run.writer.outcome(), nullptr);
  const auto lines = readTextLines(folder.path() / "trajectory.txt");
  ASSERT_EQ(lines.size(), 6U);
  const std::vector<std::string> positions = {"0.0", "0.0", "0.1", "0.1", "0.1", "0.5"};
  for (std::size_t i = 0; i < positions.size(); ++i) {
    EXPECT_THAT(
        lines[i],
        StartsWith("0." + std::to_string(i) + "00000000 0.000000000 0.000000000 " + positions[i]));
  }
}

TEST(RunWriter, TheWindowThatContradictsTheCalibrationMostIsInTheSummary) {
  const TemporaryFolder folder;
  FakeRun run(folder.path());
  playOneSegment(run);
  KeyframeSnapshot keyframe;
  keyframe.id = {2};
  EXPECT_FALSE(run.writer.calibrationSuspected());
  for (const double change : {0.1, -0.5, 0.3}) {
    keyframe.camera_score = CameraScore{change, 0.1, {0.019, 0.001}};  // too small a distortion
    run.writer.onKeyframe(keyframe);
    EXPECT_EQ(run.writer.calibrationSuspected(), change != 0.1) << "one deviation is none";
  }
  run.writer.finish(run.writer.outcome(), nullptr);
  const auto json = readJson(folder.path() / "run.json");
  EXPECT_EQ(json["calibration_suspected"].dump(), R"({"focal_change":-0.5,"focal_sigma":0.1})");
}

TEST(RunWriter, AReadoutThatAStartAsksForIsSuspectedWhereAShutterMayHaveIt) {
  for (const auto& [milliseconds, suspected] :
       {std::pair(25., true), std::pair(-25., true), std::pair(-184., false)}) {
    const TemporaryFolder folder;
    FakeRun run(folder.path());
    run.details = {{"readout_score_ms", milliseconds}, {"readout_score_sigma_ms", 4}};
    run.initializing(0);
    run.initialized(5);
    run.writer.finish(run.writer.outcome(), nullptr);
    const auto json = readJson(folder.path() / "run.json");
    EXPECT_EQ(json.contains("rolling_shutter_suspected"), suspected) << milliseconds;
  }
}

TEST(RunWriter, FiguresOfLargeImagesAreSmaller) {
  const std::vector<float> pixels(3200 * 40, 0);
  InitializationResult result;
  result.frames.resize(1);
  result.frames[0].frame = Frame::create(ImageView(pixels.data(), 3200, 40), FrameInfo());
  result.points = {{0, {1000, 20}, 0.5F, 0.01F, 3}, {0, {2000, 20}, 1, 0.01F, 3}};
  const cv::Mat figure = io::drawInverseDepth(result);
  EXPECT_EQ(figure.rows, 20);
  EXPECT_NE(figure.at<cv::Vec3b>(10, 500), cv::Vec3b());
  EXPECT_NE(figure.at<cv::Vec3b>(10, 1000), cv::Vec3b());
  EXPECT_EQ(figure.at<cv::Vec3b>(10, 750), cv::Vec3b());
}

TEST(RunWriter, ManyPointsDoNotWaitInMemory) {
  const TemporaryFolder folder;
  FakeRun run(folder.path());
  playOneSegment(run);
  for (int i = 5; i < 45; ++i) run.trackedKeyframe(i, translated(0.1 * i));
  KeyframeSnapshot keyframe;
  keyframe.id = {100};
  keyframe.camera = kCamera;
  keyframe.points.assign(20000, {{30, 30}, 1, 0.02F, 300});
  run.writer.onKeyframeRetired(keyframe);
  const auto before = fs::file_size(folder.path() / "points.ply");
  run.tracked(45);
  EXPECT_EQ(fs::file_size(folder.path() / "points.ply"), before + keyframe.points.size() * 27);
}

TEST(RunWriter, ReversedRunIsSortedByTimeAtTheEnd) {
  const TemporaryFolder folder;
  FakeRun run(folder.path());
  run.initializing(9);
  run.initialized(8);
  run.tracked(7);
  run.writer.finish(run.writer.outcome(), nullptr);
  const auto lines = readTextLines(folder.path() / "trajectory.txt");
  ASSERT_EQ(lines.size(), 3U);
  EXPECT_THAT(lines[0], StartsWith("0.700000000"));
  EXPECT_THAT(lines[2], StartsWith("0.900000000"));
  const auto start = readJson(folder.path() / "initialization.json")["initializations"][0];
  EXPECT_EQ(start["frames_since_reference"], 1);
}

TEST(RunWriter, InitializationFollowsTheSchema) {
  const TemporaryFolder folder;
  EXPECT_FALSE(fs::exists(folder.path() / "initialization.json"));
  FakeRun run(folder.path());
  EXPECT_TRUE(readJson(folder.path() / "initialization.json")["initializations"].empty());
  run.initializing(0);
  run.initializing(1, InitStatus::kRestarted);
  run.initializing(2);
  run.initialized(3);
  const auto start = readJson(folder.path() / "initialization.json")["initializations"][0];
  EXPECT_EQ(start["initializer"], "orb-v1");
  EXPECT_EQ(start["segment"], 0);
  EXPECT_EQ(start["frames_given"], 4);
  EXPECT_EQ(start["frames_since_reference"], 2);
  EXPECT_EQ(start["resets"], 1);
  EXPECT_EQ(start["refused"], false);
  EXPECT_EQ(start["reference"]["index"], 1);
  EXPECT_EQ(start["target"]["index"], 3);
  EXPECT_EQ(start["camera"]["width"], 160);
  ASSERT_EQ(start["poses"].size(), 3U);
  EXPECT_EQ(start["poses"][2]["T_cam_ref"][2][3], -0.2);
  EXPECT_EQ(start["poses"][2]["covariance"].size(), 6U);
  ASSERT_EQ(start["points"].size(), 40U) << "only those of the reference";
  EXPECT_EQ(start["points"][1].dump(), "[13.5,60.0,0.525,0.01]");
  EXPECT_EQ(start["milliseconds"]["total"], 29.0);
  EXPECT_EQ(start["milliseconds"]["this_attempt"], 26.0);
  EXPECT_EQ(start["milliseconds"]["last_frame"], 20.0);
  EXPECT_EQ(start["milliseconds"]["stages"]["tracking"], 1.5);
  EXPECT_TRUE(start["report"]["details"]["residual_rms"].is_null()) << "nan has no place in a file";
}

TEST(RunWriter, SecondSegmentGetsFilesOfItsOwn) {
  const TemporaryFolder folder;
  FakeRun run(folder.path());
  playOneSegment(run);
  run.lost(5);
  EXPECT_EQ(run.writer.outcome(), RunStatus::kLost);
  run.initializing(6);
  EXPECT_EQ(run.writer.outcome(), RunStatus::kLost);
  run.initialized(7);
  EXPECT_EQ(run.writer.outcome(), RunStatus::kTracked);
  const auto lines = [&](const char* name) { return readTextLines(folder.path() / name).size(); };
  EXPECT_EQ(lines("trajectory.txt"), 5U)
      << "no file holds two worlds, while the run goes on either";
  EXPECT_EQ(lines("trajectory_1.txt"), 2U);
  run.writer.finish(run.writer.outcome(), nullptr);
  EXPECT_EQ(lines("trajectory.txt"), 5U);
  EXPECT_EQ(lines("trajectory_0.txt"), 5U);
  EXPECT_EQ(lines("trajectory_1.txt"), 2U);
  EXPECT_EQ(lines("keyframes_1.txt"), 1U);
  EXPECT_FALSE(fs::exists(folder.path() / "trajectory_kitti.txt"));
  const auto json = readJson(folder.path() / "run.json");
  EXPECT_EQ(json["segments"], 2);
  EXPECT_EQ(json["status"], "tracked");
  const auto starts = readJson(folder.path() / "initialization.json")["initializations"];
  EXPECT_EQ(starts[1]["segment"], 1);
  EXPECT_EQ(starts[1]["frames_given"], 2);
}

TEST(RunWriter, TheLongestSegmentHasThePlainName) {
  const TemporaryFolder folder;
  FakeRun run(folder.path());
  run.initializing(0);
  run.initialized(1);
  run.lost(2);
  run.initializing(3);
  run.initialized(4);
  run.tracked(5);
  run.writer.finish(run.writer.outcome(), nullptr);
  for (const std::string name : {"trajectory", "keyframes"}) {
    EXPECT_EQ(readTextLines(folder.path() / (name + ".txt")),
              readTextLines(folder.path() / (name + "_1.txt")));
    EXPECT_TRUE(fs::exists(folder.path() / (name + "_0.txt")));
  }
}

TEST(RunWriter, ARefusedStartIsInTheListOfStartsAndNowhereElse) {
  const TemporaryFolder folder;
  FakeRun run(folder.path());
  run.initializing(0);
  run.refused(1, {.75, .25, 3.5, .5});
  EXPECT_EQ(run.writer.outcome(), RunStatus::kNeverInitialized);
  EXPECT_TRUE(readTextLines(folder.path() / "trajectory.txt").empty());
  EXPECT_FALSE(fs::exists(folder.path() / "figures" / "initial_inverse_depth.png"));
  run.initializing(2);
  run.initialized(3);
  run.writer.finish(run.writer.outcome(), nullptr);
  EXPECT_EQ(readTextLines(folder.path() / "trajectory.txt").size(), 2U);
  EXPECT_EQ(readJson(folder.path() / "run.json")["segments"], 1);
  const auto starts = readJson(folder.path() / "initialization.json")["initializations"];
  ASSERT_EQ(starts.size(), 2U);
  EXPECT_EQ(starts[0]["refused"], true);
  EXPECT_EQ(starts[0]["refusal"].dump(),
            R"({"reason":"depth","index":1,"direction_deg":0.75,"depth_spread":0.25,)"
            R"("depth_change":3.5,"kept_share":0.5})");
  EXPECT_EQ(starts[1]["refused"], false);
  EXPECT_TRUE(starts[1]["refusal"].is_null());
  EXPECT_EQ(starts[1]["frames_given"], 4) << "the segment goes on";
  EXPECT_EQ(readJson(folder.path() / "run.json")["refused"].dump(),
            R"({"adjustment":0,"direction":0,"depth":1})");
}

TEST(RunWriter, InitializationsAreWrittenAsOneDocument) {
  const TemporaryFolder folder;
  const fs::path file = folder.path() / "initialization.json";
  FakeRun run(folder.path());
  for (int segment = 0; segment < 3; ++segment) {
    run.initializing(3 * segment);
    run.initialized(3 * segment + 1);
    const io::Json json = readJson(file);
    ASSERT_EQ(json["initializations"].size(), static_cast<std::size_t>(segment) + 1);
    EXPECT_EQ(readText(file), io::jsonText(json)) << "the format of every JSON file";
    run.lost(3 * segment + 2);
  }
  run.writer.finish(run.writer.outcome(), nullptr);
  EXPECT_EQ(readJson(file)["initializations"][1]["reference"]["index"], 3);
}

TEST(RunWriter, SummaryCountsWhatWasDropped) {
  const TemporaryFolder folder;
  FakeRun run(folder.path());
  playOneSegment(run);
  run.writer.setDropped(7);
  run.writer.finish(run.writer.outcome(), nullptr);
  EXPECT_EQ(readJson(folder.path() / "run.json")["frames_dropped"], 7);
  EXPECT_EQ(readJson(folder.path() / "run.json")["frames_given"], 5);
}

TEST(RunWriter, SummaryHasTheLensAndTheAnswers) {
  const TemporaryFolder folder;
  FakeRun run(folder.path());
  const Lens lens{LensModel::kRadTan, 90, 91, 50, 40, {-0.3, 0.1, 0.01, 0.02, 0}, 101, 81};
  run.writer.setCamera(kCamera, &lens);
  playOneSegment(run);
  run.writer.finish(RunStatus::kTracked, nullptr);
  const auto json = readJson(folder.path() / "run.json");
  EXPECT_EQ(json["lens"]["model"], "radtan");
  EXPECT_EQ(json["lens"]["fy"], 91);
  EXPECT_EQ(json["lens"]["coefficients"].get<std::vector<double>>(),
            (std::vector<double>{-0.3, 0.1, 0.01, 0.02, 0}));
  EXPECT_EQ(json["lens"]["width"], 101);
  int answers = 0;
  for (const auto& count : json["answers"]) answers += count.get<int>();
  EXPECT_EQ(answers, 3) << "frames until the start: " << json["answers"];
}

TEST(RunWriter, NamesOfImagesAreQuotedWhereTheyNeedIt) {
  const TemporaryFolder folder;
  FakeRun run(folder.path());
  playOneSegment(run);
  FrameEstimate estimate;
  estimate.frame = makeFrame(5);
  run.writer.onFrame(estimate);
  run.writer.frameDone({1, 1}, "a, \"b\".png");
  EXPECT_THAT(readTextLines(folder.path() / "frames.csv").back(),
              HasSubstr(",\"a, \"\"b\"\".png\","));
}

TEST(RunWriter, TableHasOneLineAFrame) {
  const TemporaryFolder folder;
  FakeRun run(folder.path());
  playOneSegment(run);
  run.lost(5);
  const std::string none(50, ',');  // keyframe, pose and covariances
  const std::string turned_nowhere = ",0.000000000,0.000000000,0.000000000,1.000000000";
  const std::string unknown(42, ',');  // covariances
  EXPECT_THAT(
      readTextLines(folder.path() / "frames.csv"),
      ElementsAre(
          StartsWith("index,timestamp,state,milliseconds,is_keyframe,tracking_rmse,segment,image,"
                     "keyframe,rel_tx,rel_ty,rel_tz,rel_qx,rel_qy,rel_qz,rel_qw,cov_00,"),
          "0,0.000000000,initializing,3.000,0,,0," + none,
          "1,0.100000000,initializing,3.000,0,,0," + none,
          "2,0.200000000,initialized,20.000,0,,0,,0,0.000000000,0.000000000,-0.200000000" +
              turned_nowhere + unknown,
          "3,0.300000000,tracked,4.000,0,5.2500,0,,0,0.000000000,0.000000000,-0.300000000" +
              turned_nowhere + unknown,
          "4,0.400000000,tracked,4.000,0,5.2500,0,,0,0.000000000,0.000000000,-0.400000000" +
              turned_nowhere + unknown,
          "5,0.500000000,lost,3.000,0,,0," + none));
}

TEST(RunWriter, TableHasPosesRelativeToTheirKeyframesWithCovariances) {
  const TemporaryFolder folder;
  FakeRun run(folder.path());
  playOneSegment(run);
  FrameEstimate estimate;
  estimate.frame = makeFrame(5);
  estimate.keyframe = FrameId{3};
  estimate.T_cam_keyframe = SE3(Eigen::Quaterniond(0, 0, 1, 0), {1, -2, 0.5});
  Matrix6d covariance = Matrix6d::Identity();
  covariance(0, 5) = covariance(5, 0) = -0.25;
  estimate.covariance = covariance;
  estimate.world_covariance = 2 * covariance;
  run.writer.onFrame(estimate);
  run.writer.frameDone({1, 1}, "a.png");
  covariance(2, 2) = std::numeric_limits<double>::quiet_NaN();
  estimate.frame = makeFrame(6);
  estimate.covariance = covariance;
  run.writer.onFrame(estimate);
  run.writer.frameDone({1, 1}, "b.png");
  const std::vector<std::string> lines = readTextLines(folder.path() / "frames.csv");
  const auto columns = [](const std::string& line) {
    return std::count(line.begin(), line.end(), ',') + 1;
  };
  for (const std::string& line : lines) EXPECT_EQ(columns(line), columns(lines.front())) << line;
  EXPECT_THAT(lines.front(),
              EndsWith(",rel_qw,cov_00,cov_01,cov_02,cov_03,cov_04,cov_05,cov_11,"
                       "cov_12,cov_13,cov_14,cov_15,cov_22,cov_23,cov_24,cov_25,"
                       "cov_33,cov_34,cov_35,cov_44,cov_45,cov_55,world_cov_00,world_cov_01,"
                       "world_cov_02,world_cov_03,world_cov_04,world_cov_05,world_cov_11,"
                       "world_cov_12,world_cov_13,world_cov_14,world_cov_15,world_cov_22,"
                       "world_cov_23,world_cov_24,world_cov_25,world_cov_33,world_cov_34,"
                       "world_cov_35,world_cov_44,world_cov_45,world_cov_55"));
  const std::string zero = ",0.000000e+00";
  const std::string one = ",1.000000e+00";
  EXPECT_THAT(lines[lines.size() - 2],
              HasSubstr(",a.png,3,1.000000000,-2.000000000,0.500000000,0.000000000,1.000000000,"
                        "0.000000000,0.000000000" +
                        one + zero + zero + zero + zero + ",-2.500000e-01" + one));
  EXPECT_THAT(lines[lines.size() - 2], HasSubstr(one + ",2.000000e+00" + zero));
  EXPECT_THAT(lines.back(), HasSubstr(",0.000000000" + std::string(22, ',') + "2."));
}

TEST(RunWriter, PointsAreBinaryVerticesInTheWorld) {
  const TemporaryFolder folder;
  FakeRun run(folder.path());
  playOneSegment(run);
  run.retire();
  run.writer.finish(run.writer.outcome(), nullptr);
  const std::string text = readText(folder.path() / "points.ply");
  EXPECT_THAT(text, HasSubstr("format binary_little_endian 1.0"));
  EXPECT_THAT(text, HasSubstr("comment unit of each segment: units in run.json"));
  EXPECT_THAT(text, HasSubstr("element vertex 2\n"));
  const std::string end = "end_header\n";
  const std::string body = text.substr(text.find(end) + end.size());
  ASSERT_EQ(body.size(), 2U * 27U);
  float vertex[3];
  std::memcpy(vertex, body.data(), sizeof(vertex));
  EXPECT_THAT(vertex, ElementsAre(0, 0, 2)) << "image centre at inverse depth 0.5";
  EXPECT_EQ(static_cast<unsigned char>(body[12]), 100);
  EXPECT_EQ(static_cast<unsigned char>(body[27 + 12]), 255) << "clamped";
}

TEST(RunWriter, PointsStandWhereAJoinPutsThem) {
  const TemporaryFolder folder;
  FakeRun run(folder.path());
  playOneSegment(run);
  run.lost(5);  // retires the keyframe
  run.writer.onSegmentsJoined({0, 7, {translated(1), 2}, Matrix7d::Zero(), 1, 30, 0});
  run.writer.finish(run.writer.outcome(), nullptr);
  const std::string text = readText(folder.path() / "points.ply");
  const char* const vertex = text.data() + text.size() - std::size_t{2} * 27;
  std::array<float, 3> place{};
  float variance = 0;
  std::int32_t segment = 0;
  std::memcpy(place.data(), vertex, sizeof place);
  std::memcpy(&variance, vertex + 15, sizeof variance);
  std::memcpy(&segment, vertex + 19, sizeof segment);
  EXPECT_THAT(place, ElementsAre(0, 0, 5)) << "twice 2, and one ahead";
  EXPECT_FLOAT_EQ(variance, 0.0025F);
  EXPECT_EQ(segment, 7);
}

}  // namespace
}  // namespace dsorb
