// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/tracks/learned_features.h"

#include "dsorb/error.h"
#include "dsorb/init/initializer.h"

#include "init/orb/tracks/far_matches.h"
#include "support/temporary_folder.h"
#include "support/tiny_network.h"
#include "synthetic/sequence.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <string>

namespace dsorb::init_orb {
namespace {

using testing::HasSubstr;

constexpr int kColumns = 8;
constexpr int kRows = 6;
constexpr int kCells = kColumns * kRows;
constexpr int kNoKeypoint = kLearnedCell * kLearnedCell;  // its logit

void write(const std::string& file, const std::string& bytes) {
  std::ofstream(file, std::ios::binary) << bytes;
}

GreyImage greyOf(int width, int height) {
  return {cv::Mat::zeros(height, width, CV_8UC1), {}};
}

/// No keypoint anywhere; the descriptors turn with the column.
LearnedMaps emptyMaps() {
  LearnedMaps maps{kColumns, kRows, {}, {}, {}};
  maps.keypoints = cv::Mat::zeros(kNoKeypoint + 1, kCells, CV_32F);
  maps.keypoints.row(kNoKeypoint) = 9.0F;
  maps.reliability = cv::Mat::ones(1, kCells, CV_32F);
  maps.descriptors = cv::Mat(2, kCells, CV_32F);
  for (int cell = 0; cell < kCells; ++cell) {
    const double angle = 0.1 * (cell % kColumns);
    maps.descriptors.at<float>(0, cell) = 3 * static_cast<float>(std::cos(angle));
    maps.descriptors.at<float>(1, cell) = 3 * static_cast<float>(std::sin(angle));
  }
  return maps;
}

/// @param logit that of no keypoint is 9
void putKeypoint(LearnedMaps& maps, int x, int y, float logit) {
  const int cell = y / kLearnedCell * kColumns + x / kLearnedCell;
  const int pixel = y % kLearnedCell * kLearnedCell + x % kLearnedCell;
  maps.keypoints.at<float>(pixel, cell) = logit;
}

TEST(LearnedFeatures, AreTheMaximaTheMostProbableFirst) {
  LearnedMaps maps = emptyMaps();
  putKeypoint(maps, 20, 13, 10);
  putKeypoint(maps, 41, 30, 12);
  putKeypoint(maps, 42, 30, 10);  // beside a larger one
  putKeypoint(maps, 25, 29, 2);   // improbable
  putKeypoint(maps, 1, 30, 12);   // too close to the border
  const Features found =
      readFeatures(maps, greyOf(kColumns * kLearnedCell, kRows * kLearnedCell), 9);
  ASSERT_EQ(found.points.size(), 2U);
  EXPECT_EQ(found.points[0].pt, cv::Point2f(41, 30));
  EXPECT_EQ(found.points[1].pt, cv::Point2f(20, 13));
  const Features best =
      readFeatures(maps, greyOf(kColumns * kLearnedCell, kRows * kLearnedCell), 1);
  ASSERT_EQ(best.points.size(), 1U);
  EXPECT_EQ(best.descriptors.rows, 1);
}

TEST(LearnedFeatures, DescriptorsAreInterpolatedAndOfUnitLength) {
  LearnedMaps maps = emptyMaps();
  putKeypoint(maps, 28, 20, 12);  // half a pixel right of the middle of column 3
  const Features found =
      readFeatures(maps, greyOf(kColumns * kLearnedCell, kRows * kLearnedCell), 9);
  ASSERT_EQ(found.descriptors.rows, 1);
  EXPECT_NEAR(cv::norm(found.descriptors), 1, 1e-6);
  const double angle =
      std::atan2(found.descriptors.at<float>(0, 1), found.descriptors.at<float>(0, 0));
  EXPECT_NEAR(angle, 0.1 * (3 + 0.5 / kLearnedCell), 0.004);  // 0.0026: cubics bend a line
}

TEST(LearnedFeatures, InputHasMeanZeroVarianceOneAndFullCells) {
  cv::Mat grey(50, 70, CV_8UC1);
  cv::randu(grey, 20, 90);
  const cv::Mat input = networkInput(grey);
  EXPECT_EQ(input.size(), cv::Size(96, 64));
  cv::Scalar mean;
  cv::Scalar deviation;
  cv::meanStdDev(input(cv::Rect(0, 0, 70, 50)), mean, deviation);
  EXPECT_NEAR(mean[0], 0, 1e-5);
  EXPECT_NEAR(deviation[0], 1, 1e-5);
  EXPECT_EQ(input.at<float>(10, 70), input.at<float>(10, 69));  // mirrored
  EXPECT_TRUE(cv::checkRange(networkInput(cv::Mat(50, 70, CV_8UC1, cv::Scalar(7)))));
}

std::string errorOf(const std::string& file) {
  InitializerOptions options;
  options.feature_network = file;
  try {
    (void)makeInitializer(options, {400, 400, 159.5, 119.5, 320, 240});
  } catch (const ConfigError& error) {
    return std::string("ConfigError ") + error.what();
  } catch (const IoError& error) {
    return std::string("IoError ") + error.what();
  }
  return "no error";
}

TEST(LearnedFeatures, WithoutWhatTheyNeedAreRefusedByName) {
  if (!builtWithDnn()) {
    EXPECT_THAT(errorOf("mine.onnx"),
                testing::AllOf(
                    HasSubstr("ConfigError"), HasSubstr("mine.onnx"), HasSubstr("DSORB_WITH_DNN")));
    return;
  }
  EXPECT_THAT(errorOf("/nowhere/mine.onnx"),
              testing::AllOf(HasSubstr("IoError"), HasSubstr("/nowhere/mine.onnx")));
  const TemporaryFolder folder;
  const std::string damaged = (folder.path() / "damaged.onnx").string();
  write(damaged, tinyNetwork().substr(0, 400));
  EXPECT_THAT(errorOf(damaged), testing::AllOf(HasSubstr("IoError"), HasSubstr("damaged.onnx")));
}

TEST(LearnedFeatures, OfATinyNetwork) {
  if (!builtWithDnn()) GTEST_SKIP() << "built without DSORB_WITH_DNN";
  const TemporaryFolder folder;
  const std::string file = (folder.path() / "tiny.onnx").string();
  write(file, tinyNetwork());
  const std::unique_ptr<FeatureFinder> finder = makeLearnedFinder(file);
  const int sizes[][2] = {{64, 48}, {75, 50}, {64, 48}};  // one network for images of every size
  for (const auto& size : sizes) {
    GreyImage image = greyOf(size[0], size[1]);
    cv::randu(image.grey, 0, 255);
    const Features found = finder->find(image);
    ASSERT_FALSE(found.points.empty());
    EXPECT_EQ(found.descriptors.cols, 4);
    for (const cv::KeyPoint& point : found.points) {
      EXPECT_EQ(static_cast<int>(point.pt.x) % kLearnedCell, 5);
      EXPECT_EQ(static_cast<int>(point.pt.y) % kLearnedCell, 3);
    }
  }
}

/// A network as scripts/export_xfeat.py writes it.
TEST(LearnedFeatures, OfXFeatFindARoomAgain) {
  const char* file = std::getenv("DSORB_FEATURE_NETWORK");
  if (!builtWithDnn() || file == nullptr) {
    GTEST_SKIP() << "needs DSORB_WITH_DNN and a network in DSORB_FEATURE_NETWORK";
  }
  synthetic::SequenceOptions options;
  options.length = 13;
  const synthetic::SyntheticSequence room(options);
  const std::unique_ptr<FeatureFinder> finder = makeLearnedFinder(file);
  const auto describe = [&](int index) { return describeFrame(room.framePtr(index), 1, *finder); };
  const DescribedFrame from = describe(0);
  const std::vector<Eigen::Vector2f> found = findAgain(from, describe(12));
  const std::vector<float> inverse_depth = room.inverseDepth(0);
  const SE3 T_to_from = room.pose(12).inverse() * room.pose(0);
  int seen = 0;
  int right = 0;
  for (std::size_t i = 0; i < found.size(); ++i) {
    if (!isSeen(found[i])) continue;
    const Eigen::Vector2d pixel = from.positions[i].cast<double>();
    const auto at = static_cast<std::size_t>(pixel.y()) * 640 + static_cast<std::size_t>(pixel.x());
    const Eigen::Vector3d ray = room.camera().unproject(pixel);
    const Eigen::Vector3d moved = T_to_from.rotationMatrix() * ray +
                                  static_cast<double>(inverse_depth[at]) * T_to_from.translation();
    ++seen;
    right += (room.camera().project(moved) - found[i].cast<double>()).norm() < 2 ? 1 : 0;
  }
  RecordProperty("seen", seen);
  RecordProperty("right", right);
  EXPECT_GT(seen, 300);
  EXPECT_GT(right, 0.9 * seen);
}

}  // namespace
}  // namespace dsorb::init_orb
