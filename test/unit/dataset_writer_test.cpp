// SPDX-License-Identifier: BSD-3-Clause
#include "app/dataset_writer.h"

#include "dsorb/error.h"
#include "dsorb/io/sequence_reader.h"

#include "support/temporary_folder.h"
#include "synthetic/sequence.h"

#include <gmock/gmock.h>
#include <nlohmann/json.hpp>
#include <opencv2/imgcodecs.hpp>

#include <fstream>
#include <sstream>
#include <string>
#include <vector>

namespace dsorb {
namespace {

namespace fs = std::filesystem;

std::string contentOf(const fs::path& file) {
  std::ifstream stream(file);
  std::ostringstream text;
  text << stream.rdbuf();
  return text.str();
}

synthetic::SequenceOptions smallStreet() {
  synthetic::SequenceOptions options;
  options.kind = synthetic::SequenceKind::kStreet;
  options.width = 160;
  options.height = 96;
  options.length = 3;
  return options;
}

TEST(DatasetWriter, WritesWhatTheReaderReads) {
  synthetic::SequenceOptions options = smallStreet();
  options.nonlinear_response = true;
  options.vignette = true;
  options.exposure_changes = 0.3;
  const synthetic::SyntheticSequence sequence(options);
  const TemporaryFolder folder;
  app::writeDataset(sequence, folder.path() / "street");
  SequenceOptions reading;
  reading.path = (folder.path() / "street").string();
  SequenceReader reader(reading);
  ASSERT_EQ(reader.size(), 3);
  EXPECT_EQ(reader.brightness(), BrightnessModel::kCalibrated);
  EXPECT_DOUBLE_EQ(reader.camera().fx, sequence.camera().fx);
  EXPECT_DOUBLE_EQ(reader.camera().cx, sequence.camera().cx);
  for (int index = 0; index < 3; ++index) {
    const FramePtr read = reader.next()->frame;
    const FramePtr made = sequence.framePtr(index);
    EXPECT_NEAR(read->timestamp(), made->timestamp(), 1e-9);
    EXPECT_NEAR(read->exposure(), made->exposure(), 1e-9);
    for (int y = 0; y < 96; y += 5) {
      for (int x = 0; x < 160; x += 5) {
        // The 16-bit vignette rounds by 1 / 65535 of 0.6 at least.
        EXPECT_NEAR(read->level(0).at(x, y).intensity, made->level(0).at(x, y).intensity, 0.02);
      }
    }
  }
}

TEST(DatasetWriter, WritesDepthInMillimetresAndThePoses) {
  const synthetic::SyntheticSequence sequence(smallStreet());
  const TemporaryFolder folder;
  app::writeDataset(sequence, folder.path() / "street");
  const cv::Mat depth =
      cv::imread((folder.path() / "street/depth/00002.png").string(), cv::IMREAD_UNCHANGED);
  ASSERT_EQ(depth.type(), CV_16U);
  const std::vector<float> inverse_depth = sequence.inverseDepth(2);
  int known = 0;
  for (int i = 0; i < 160 * 96; ++i) {
    const int millimetres = depth.at<std::uint16_t>(i / 160, i % 160);
    const double expected = 1e3 / inverse_depth[static_cast<std::size_t>(i)];
    known += static_cast<int>(millimetres > 0);
    EXPECT_NEAR(millimetres, expected < 65535.5 ? expected : 0.0, 0.501);
  }
  EXPECT_GT(known, 160 * 96 / 2);
  std::ifstream truth(folder.path() / "street/groundtruth.txt");
  std::string line;
  for (int row = 0; row <= 3; ++row) std::getline(truth, line);
  std::istringstream words(line);
  double time = 0;
  Eigen::Vector3d t;
  Eigen::Quaterniond q;
  words >> time >> t.x() >> t.y() >> t.z() >> q.x() >> q.y() >> q.z() >> q.w();
  EXPECT_NEAR(time, 0.2, 1e-9);
  EXPECT_LT((SE3(q, t).matrix() - sequence.pose(2).matrix()).norm(), 1e-8);
}

TEST(DatasetWriter, MergesItsEntryIntoTheListOfTheParentFolder) {
  const TemporaryFolder folder;
  std::ofstream(folder.path() / "sequences.json")
      << R"({"mine": {"path": "a/b", "frames": 9, "note": "kept"}})";
  synthetic::SequenceOptions options = smallStreet();
  app::writeDataset(synthetic::SyntheticSequence(options), folder.path() / "street");
  options.kind = synthetic::SequenceKind::kStatic;
  options.length = 2;
  app::writeDataset(synthetic::SyntheticSequence(options),
                    folder.path() / "still/");  // a trailing slash
  const auto list = nlohmann::json::parse(contentOf(folder.path() / "sequences.json"));
  EXPECT_EQ(list, nlohmann::json::parse(R"({
      "mine": {"path": "a/b", "frames": 9, "note": "kept"},
      "street": {"path": "street", "frames": 3},
      "still": {"path": "still", "frames": 2, "no_start": true}})"));
}

TEST(DatasetWriter, ReplacesAnEarlierDataSet) {
  const TemporaryFolder folder;
  synthetic::SequenceOptions options = smallStreet();
  options.vignette = true;
  app::writeDataset(synthetic::SyntheticSequence(options), folder.path() / "a");
  EXPECT_TRUE(fs::exists(folder.path() / "a/vignette.png"));
  EXPECT_TRUE(fs::exists(folder.path() / "a/pcalib.txt"));
  options.vignette = false;
  options.length = 2;
  app::writeDataset(synthetic::SyntheticSequence(options), folder.path() / "a");
  EXPECT_FALSE(fs::exists(folder.path() / "a/vignette.png"));
  EXPECT_FALSE(fs::exists(folder.path() / "a/pcalib.txt"));
  EXPECT_FALSE(fs::exists(folder.path() / "a/images/00002.png"));
  EXPECT_FALSE(fs::exists(folder.path() / "a/depth/00002.png"));
}

TEST(DatasetWriter, LeavesFilesOfOthersAlone) {
  const TemporaryFolder folder;
  const fs::path image = folder.path() / "mine/images/000000.png";
  fs::create_directories(image.parent_path());
  std::ofstream(image) << "of somebody";
  try {
    app::writeDataset(synthetic::SyntheticSequence(smallStreet()), folder.path() / "mine");
    FAIL() << "wrote among them";
  } catch (const IoError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("sequences.json does not list it"));
  }
  EXPECT_TRUE(fs::exists(image));
}

TEST(DatasetWriter, NamesTheFileItCannotWrite) {
  const TemporaryFolder folder;
  std::ofstream(folder.path() / "file") << "not a folder";
  const synthetic::SyntheticSequence sequence(smallStreet());
  try {
    app::writeDataset(sequence, folder.path() / "file/street");
    FAIL() << "wrote below a file";
  } catch (const IoError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("file/street"));
  }
  std::ofstream(folder.path() / "sequences.json") << "[1, 2";
  try {
    app::writeDataset(sequence, folder.path() / "street");
    FAIL() << "took a broken list";
  } catch (const IoError& error) {
    EXPECT_THAT(error.what(), testing::HasSubstr("sequences.json"));
  }
  EXPECT_EQ(contentOf(folder.path() / "sequences.json"), "[1, 2");
}

}  // namespace
}  // namespace dsorb
