// SPDX-License-Identifier: BSD-3-Clause
#include "io/output/recording_writer.h"

#include "dsorb/error.h"

#include "support/temporary_folder.h"

#include <gmock/gmock.h>
#include <opencv2/imgcodecs.hpp>

#include <fstream>
#include <limits>
#include <string>
#include <vector>

namespace dsorb {
namespace {

namespace fs = std::filesystem;
using ::testing::ElementsAre;

const PinholeCamera kRecordedCamera{100, 100, 79.5, 59.5, 160, 120};
constexpr float kGrey = 120;

FramePtr recordedFrame(int index) {
  const std::vector<float> pixels(160 * 120, kGrey + static_cast<float>(index));
  FrameInfo info;
  info.id = {index};
  info.timestamp = 0.1 * index;
  return Frame::create(ImageView(pixels.data(), 160, 120), info);
}

SE3 forward(double z) {
  return {Eigen::Quaterniond::Identity(), Eigen::Vector3d(0, 0, z)};
}

MapPoint point(float u, float v, float inverse_depth) {
  MapPoint point;
  point.pixel = {u, v};
  point.inverse_depth = inverse_depth;
  point.variance = 0.01F;
  point.intensity = kGrey;
  return point;
}

KeyframeSnapshot makeKeyframe(int index, std::vector<MapPoint> points) {
  KeyframeSnapshot keyframe;
  keyframe.id = {index};
  keyframe.timestamp = 0.1 * index;
  keyframe.camera = kRecordedCamera;
  keyframe.points = std::move(points);
  return keyframe;
}

FrameEstimate tracked(int index, double z) {
  FrameEstimate estimate;
  estimate.frame = recordedFrame(index);
  estimate.state = OdometryState::kTracked;
  estimate.T_world_cam = forward(z);
  estimate.keyframe = FrameId{0};
  estimate.T_cam_keyframe = forward(-z);
  estimate.tracking_rmse = 3.5;
  return estimate;
}

std::vector<io::Json> readLines(const fs::path& path) {
  std::ifstream file(path);
  std::vector<io::Json> lines;
  for (std::string line; std::getline(file, line);) lines.push_back(io::Json::parse(line));
  return lines;
}

std::vector<std::string> kindsOf(const std::vector<io::Json>& lines) {
  std::vector<std::string> kinds;
  for (const io::Json& line : lines) kinds.push_back(line.at("kind"));
  return kinds;
}

class RecordingWriterTest : public ::testing::Test {
 protected:
  RecordingWriterTest() {
    info_.program = "dso_dataset";
    info_.version = "1.2.3";
    info_.initializer = "orb";
  }

  TemporaryFolder folder_;
  fs::path path_ = folder_.path() / "deep" / "run.jsonl";
  RunInfo info_;
};

TEST_F(RecordingWriterTest, LinesComeInTheOrderTheFormatPromises) {
  io::RecordingWriter writer(path_, info_, kRecordedCamera);
  EXPECT_THAT(kindsOf(readLines(path_)), ElementsAre("header"));
  KeyframeSnapshot keyframe = makeKeyframe(0, {point(79.5F, 59.5F, 0.5F)});
  keyframe.camera.fx = 102;  // refined
  writer.onKeyframe(keyframe);
  const FrameEstimate estimate = tracked(1, 1.0);
  writer.onFrame(estimate);
  writer.frameDone(estimate);
  const std::vector<io::Json> lines = readLines(path_);
  EXPECT_THAT(kindsOf(lines), ElementsAre("header", "image", "keyframe", "points", "pose"));
  EXPECT_EQ(lines[0].at("program"), "dso_dataset 1.2.3");
  EXPECT_EQ(lines[0].at("camera").at("width"), 160);
  EXPECT_EQ(lines[0].at("camera").at("fx"), 100);
  EXPECT_EQ(lines[2].at("camera").at("fx"), 102);
  EXPECT_EQ(lines[4].at("pose"), io::Json({0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0}));
  EXPECT_EQ(lines[4].at("rmse"), 3.5);
  writer.onLost({1}, 0);
  writer.finish(RunStatus::kLost);
  EXPECT_EQ(readLines(path_).back().at("status"), "lost");
  EXPECT_EQ(readLines(path_)[5].at("kind"), "lost");
}

TEST_F(RecordingWriterTest, ImagesLieBesideTheRecording) {
  io::RecordingWriter writer(path_, info_, kRecordedCamera);
  const FrameEstimate estimate = tracked(7, 1.0);
  writer.onFrame(estimate);
  writer.frameDone(estimate);
  const io::Json line = readLines(path_).at(1);
  EXPECT_EQ(line.at("file"), "run_images/000007.png");
  const fs::path file = path_.parent_path() / line.at("file").get<std::string>();
  const cv::Mat image = cv::imread(file.string(), cv::IMREAD_UNCHANGED);
  ASSERT_EQ(image.size(), cv::Size(160, 120));
  EXPECT_EQ(image.at<uchar>(60, 80), 127);
}

TEST_F(RecordingWriterTest, AnInitializationBringsPoses) {
  io::RecordingWriter writer(path_, info_, kRecordedCamera);
  InitStep step;
  step.status = InitStatus::kInitialized;
  step.reason = InitReason::kDone;
  step.result.emplace();
  step.result->frames.resize(3);
  for (std::size_t i = 0; i < 3; ++i) {
    step.result->frames[i].frame = recordedFrame(static_cast<int>(i) + 4);
    if (i != 1) step.result->frames[i].T_cam_ref = forward(-0.5 * static_cast<double>(i));
  }
  writer.onInitStep(step, *step.result->frames.back().frame, 0);
  FrameEstimate estimate;
  estimate.frame = step.result->frames.back().frame;
  writer.frameDone(estimate);
  const std::vector<io::Json> lines = readLines(path_);
  ASSERT_THAT(kindsOf(lines), ElementsAre("header", "image", "init"));
  EXPECT_EQ(lines[2].at("reference"), 4);
  EXPECT_TRUE(lines[2].at("poses").at(1).at(1).is_null());
  EXPECT_EQ(lines[2].at("poses").at(2).at(1).at(2), 1.0);
}

TEST_F(RecordingWriterTest, AMetricStartIsToldInMetresAndARefusalFollowsIt) {
  io::RecordingWriter writer(path_, info_, kRecordedCamera);
  InitStep step;
  step.status = InitStatus::kInitialized;
  step.result.emplace();
  for (int i = 0; i < 2; ++i) {
    step.result->frames.push_back({recordedFrame(i), forward(-0.5 * i), {}, std::nullopt});
  }
  step.result->metric = MetricScale{4, .01, 0};
  writer.onInitStep(step, *step.result->frames.back().frame, 0);
  StartRefusal refusal;
  refusal.frame = {1};
  refusal.reason = RefusalReason::kDepth;
  writer.onStartRefused(refusal);
  FrameEstimate estimate;
  estimate.frame = step.result->frames.back().frame;
  writer.frameDone(estimate);
  const std::vector<io::Json> lines = readLines(path_);
  ASSERT_THAT(kindsOf(lines), ElementsAre("header", "image", "init", "refused"));
  EXPECT_EQ(lines[2].at("poses").at(1).at(1).at(2), 2.0);
  EXPECT_EQ(lines[3].at("reason"), "depth");
}

TEST_F(RecordingWriterTest, ImagesOfOthersStayAsTheyAre) {
  const fs::path images = path_.parent_path() / "run_images";
  fs::create_directories(images);
  std::ofstream(images / "000000.png") << "of somebody";
  EXPECT_THROW(io::RecordingWriter(path_, info_, kRecordedCamera), IoError);
  fs::remove(images / "000000.png");
  const FrameEstimate estimate = tracked(0, 1);
  for (int run = 0; run < 2; ++run) {  // the second replaces the first
    io::RecordingWriter writer(path_, info_, kRecordedCamera);
    writer.onFrame(estimate);
    writer.frameDone(estimate);
  }
  EXPECT_TRUE(fs::exists(images / "000000.png"));
}

TEST_F(RecordingWriterTest, NumbersThatAreNoneAreLeftOut) {
  constexpr float kNan = std::numeric_limits<float>::quiet_NaN();
  io::RecordingWriter writer(path_, info_, kRecordedCamera);
  writer.onKeyframe(makeKeyframe(0, {point(1, 1, kNan), point(1, 1, 1)}));
  FrameEstimate estimate = tracked(1, std::numeric_limits<double>::quiet_NaN());
  estimate.tracking_rmse = std::numeric_limits<double>::infinity();
  writer.onFrame(estimate);
  writer.frameDone(estimate);
  const std::vector<io::Json> lines = readLines(path_);
  EXPECT_EQ(lines[3].at("points").size(), 1U);
  EXPECT_TRUE(lines[4].at("pose").is_null());
  EXPECT_TRUE(lines[4].at("rmse").is_null());
}

TEST_F(RecordingWriterTest, AFileInTheWayIsAnError) {
  std::ofstream(folder_.path() / "deep") << "no folder";
  EXPECT_THROW(io::RecordingWriter(path_, info_, kRecordedCamera), IoError);
}

}  // namespace
}  // namespace dsorb
