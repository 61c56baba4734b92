// SPDX-License-Identifier: BSD-3-Clause
// Calibration files of other programs: ROS, OpenCV, COLMAP.
#include "dsorb/error.h"
#include "dsorb/io/calibration_reader.h"

#include "support/temporary_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <array>
#include <fstream>
#include <string>

namespace dsorb {
namespace {

using testing::AllOf;
using testing::HasSubstr;

class CalibrationFormsTest : public testing::Test {
 protected:
  std::string write(const std::string& name, const std::string& text) {
    const auto file = folder_.path() / name;
    std::ofstream(file, std::ios::binary) << text;
    return file.string();
  }
  Lens lensOf(const std::string& name, const std::string& text) {
    return readCalibration(write(name, text)).lens;
  }
  std::string complaint(const std::string& name, const std::string& text) {
    try {
      (void)lensOf(name, text);
    } catch (const IoError& error) {
      return error.what();
    }
    return "nothing was thrown";
  }
  TemporaryFolder folder_;
};

void expectLens(const Lens& lens, const Lens& expected) {
  EXPECT_EQ(lens.model, expected.model);
  EXPECT_EQ(lens.fx, expected.fx);
  EXPECT_EQ(lens.fy, expected.fy);
  EXPECT_EQ(lens.cx, expected.cx);
  EXPECT_EQ(lens.cy, expected.cy);
  EXPECT_EQ(lens.width, expected.width);
  EXPECT_EQ(lens.height, expected.height);
  EXPECT_EQ(lens.coefficients, expected.coefficients);
}

const Lens kRadTanLens = {
    LensModel::kRadTan, 500, 510, 320, 240, {-0.3, 0.1, 0.001, -0.002, 0.05}, 640, 480};

std::string withReplaced(std::string text, const std::string& from, const std::string& to) {
  return text.replace(text.find(from), from.size(), to);
}

const std::string kRos =  // camera_calibration of ROS
    "image_width: 640\nimage_height: 480\ncamera_name: head\ncamera_matrix:\n  rows: 3\n  cols: 3\n"
    "  data: [500, 0, 320, 0, 510, 240, 0, 0, 1]\ndistortion_model: plumb_bob\n"
    "distortion_coefficients:\n  rows: 1\n  cols: 5\n  data: [-0.3, 0.1, 0.001, -0.002, 0.05]\n"
    "rectification_matrix:\n  rows: 3\n  cols: 3\n  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]\n";

TEST_F(CalibrationFormsTest, RosCameraInfo) {
  const Calibration calibration = readCalibration(write("head.yaml", kRos));
  expectLens(calibration.lens, kRadTanLens);
  EXPECT_EQ(calibration.rectification.mode, RectificationMode::kCrop);

  const std::string message =  // ros2 topic echo --once /camera_info
      "header:\n  frame_id: cam\nheight: 480\nwidth: 640\ndistortion_model: equidistant\n"
      "d: [0.1, 0.2, 0.3, 0.4]\nk: [500.0, 0.0, 320.0, 0.0, 510.0, 240.0, 0.0, 0.0, 1.0]\n---\n";
  const Lens fisheye = lensOf("info.yaml", message);
  expectLens(fisheye,
             {LensModel::kEquidistant, 500, 510, 320, 240, {0.1, 0.2, 0.3, 0.4}, 640, 480});

  const std::string plain =
      withReplaced(kRos, "[-0.3, 0.1, 0.001, -0.002, 0.05]", "[0, 0, 0, 0, 0]");
  const Calibration rectified = readCalibration(write("head.yaml", plain));
  EXPECT_EQ(rectified.lens.model, LensModel::kPinhole);
  EXPECT_EQ(rectified.rectification.mode, RectificationMode::kNone);
}

TEST_F(CalibrationFormsTest, MatricesMayBeFollowedByTheReadout) {
  const Lens rows = lensOf("head.yaml", kRos + "readout_ms: 25\n");
  EXPECT_DOUBLE_EQ(rows.readout.seconds, 0.025);
  EXPECT_FALSE(rows.columns);
  const Lens columns = lensOf("a.xml",
                              "<opencv_storage>\n<K>\n<data>500 0 320 0 510 240 0 0 1</data></K>\n"
                              "<readout_ms>-20 columns</readout_ms>\n</opencv_storage>\n");
  EXPECT_DOUBLE_EQ(columns.readout.seconds, -0.02);
  EXPECT_TRUE(columns.columns);
  EXPECT_THAT(complaint("head.yaml", kRos + "readout_ms: soon\n"),
              AllOf(HasSubstr("head.yaml:17"), HasSubstr("readout_ms: milliseconds")));
}

TEST_F(CalibrationFormsTest, OpenCvFileStorage) {
  for (const std::string suffix : {".yaml", ".yml", ".xml"}) {
    const std::string file = (folder_.path() / ("opencv" + suffix)).string();
    {
      cv::FileStorage storage(file, cv::FileStorage::WRITE);
      storage << "calibration_time"
              << "Mon 23 Nov"
              << "image_width" << 640 << "image_height" << 480 << "camera_matrix"
              << (cv::Mat)(cv::Mat_<double>(3, 3) << 500, 0, 320, 0, 510, 240, 0, 0, 1)
              << "distortion_coefficients"
              << (cv::Mat)(cv::Mat_<double>(5, 1) << -0.3, 0.1, 0.001, -0.002, 0.05);
    }
    expectLens(readCalibration(file).lens, kRadTanLens);
    {
      cv::FileStorage storage(file, cv::FileStorage::WRITE);
      storage << "fisheye_model" << 1 << "K"
              << (cv::Mat)(cv::Mat_<double>(3, 3) << 500, 0, 320, 0, 510, 240, 0, 0, 1) << "D"
              << (cv::Mat)(cv::Mat_<double>(1, 4) << 0.1, 0.2, 0.3, 0.4);
    }
    // Without a size it is that of the images.
    expectLens(readCalibration(file).lens,
               {LensModel::kEquidistant, 500, 510, 320, 240, {0.1, 0.2, 0.3, 0.4}, 0, 0});
  }
}

TEST_F(CalibrationFormsTest, ColmapCameras) {
  const std::string head = "# Camera list with one line of data per camera:\n# Number: 1\n";
  const struct {
    const char* line;
    Lens lens;
  } forms[] = {
      {"1 SIMPLE_PINHOLE 640 480 500 320 240",
       {LensModel::kPinhole, 500, 500, 319.5, 239.5, {}, 640, 480}},
      {"1 PINHOLE 640 480 500 510 320 240",
       {LensModel::kPinhole, 500, 510, 319.5, 239.5, {}, 640, 480}},
      {"1 SIMPLE_RADIAL 640 480 500 320 240 0.1",
       {LensModel::kRadTan, 500, 500, 319.5, 239.5, {0.1}, 640, 480}},
      {"1 RADIAL 640 480 500 320 240 0.1 0.2",
       {LensModel::kRadTan, 500, 500, 319.5, 239.5, {0.1, 0.2}, 640, 480}},
      {"7 OPENCV 640 480 500 510 320 240 1 2 3 4",
       {LensModel::kRadTan, 500, 510, 319.5, 239.5, {1, 2, 3, 4}, 640, 480}},
      {"1 FULL_OPENCV 640 480 500 510 320 240 1 2 3 4 5 0 0 0",
       {LensModel::kRadTan, 500, 510, 319.5, 239.5, {1, 2, 3, 4, 5}, 640, 480}},
      {"1 OPENCV_FISHEYE 640 480 500 510 320 240 1 2 3 4",
       {LensModel::kEquidistant, 500, 510, 319.5, 239.5, {1, 2, 3, 4}, 640, 480}},
      {"1 RADIAL_FISHEYE 640 480 500 320 240 1 2",
       {LensModel::kEquidistant, 500, 500, 319.5, 239.5, {1, 2}, 640, 480}},
      {"1 FOV 640 480 500 510 320 240 0.9",
       {LensModel::kFov, 500, 510, 319.5, 239.5, {0.9}, 640, 480}},
  };
  for (const auto& form : forms) {
    SCOPED_TRACE(form.line);
    expectLens(lensOf("cameras.txt", head + form.line + "\n"), form.lens);
  }
}

TEST_F(CalibrationFormsTest, MatrixComplaintsNameLineAndKey) {
  EXPECT_THAT(complaint("a.yaml", withReplaced(kRos, "0, 0, 1]", "0, 0]")),
              AllOf(HasSubstr("a.yaml:5"), HasSubstr("camera_matrix: 8 numbers")));
  EXPECT_THAT(complaint("a.yaml", withReplaced(kRos, "[500, 0,", "[500, 3,")),
              HasSubstr("camera_matrix: expected fx 0 cx"));
  EXPECT_THAT(complaint("a.yaml", withReplaced(kRos, "[500,", "[-500,")),
              HasSubstr("camera_matrix: focal lengths -500 510"));
  EXPECT_THAT(complaint("a.yaml", withReplaced(kRos, "[500,", "[.nan,")),
              HasSubstr("camera_matrix: finite numbers"));
  EXPECT_THAT(complaint("a.yaml", withReplaced(kRos, " 320,", " 700,")),
              HasSubstr("principal point 700 240; expected inside the image of 640x480"));
  EXPECT_THAT(complaint("a.yaml", withReplaced(kRos, "plumb_bob", "omni")),
              AllOf(HasSubstr("a.yaml:8"), HasSubstr("'omni'")));
  EXPECT_THAT(complaint("a.yaml", withReplaced(kRos, "0.05]", "0.05, 0.1, 0.2, 0.3]")),
              AllOf(HasSubstr("distortion coefficient 6 is 0.1"), HasSubstr("rational")));
  EXPECT_THAT(complaint("a.yaml", withReplaced(kRos, "image_width: 640", "image_width: 640.5")),
              HasSubstr("image_width: image size 640.5x480"));
  EXPECT_THAT(complaint("a.yaml", withReplaced(kRos, "image_height: 480\n", "")),
              HasSubstr("expected together"));
  EXPECT_THAT(complaint("a.xml", "no xml"), HasSubstr("a.xml:1: no XML"));
  EXPECT_THAT(complaint("a.xml", "<?xml version=\"1.0\"?>\n<calibration/>\n"),
              HasSubstr("a.xml: an XML file of OpenCV is expected"));
  EXPECT_THAT(complaint("a.xml",
                        "<opencv_storage>\n<K>\n<data>500 0 x 0 510 240 0 0 1</data></K>\n"
                        "</opencv_storage>\n"),
              HasSubstr("a.xml:2: K: at most 64 finite numbers are expected"));
  EXPECT_THAT(
      complaint("a.xml", "<?xml version=\"1.0\"?>\n<opencv_storage>\n<a>1</a></opencv_storage>\n"),
      HasSubstr("a.xml: no camera_matrix"));
}

TEST_F(CalibrationFormsTest, ColmapComplaintsNameTheLine) {
  EXPECT_THAT(
      complaint("c.txt", "1 THIN_PRISM_FISHEYE 640 480 500 510 320 240 1 2 3 4 5 6 7 8\n"),
      AllOf(HasSubstr("c.txt:1"), HasSubstr("THIN_PRISM_FISHEYE"), HasSubstr("OPENCV_FISHEYE")));
  EXPECT_THAT(complaint("c.txt", "1 OPENCV 640 480 500 510 320 240 1 2 3\n"),
              AllOf(HasSubstr("9 numbers after the model"), HasSubstr("k1 k2 p1 p2")));
  EXPECT_THAT(complaint("c.txt", "1 FULL_OPENCV 640 480 500 510 320 240 1 2 3 4 5 6 0 0\n"),
              HasSubstr("distortion coefficient 6 is 6"));
  EXPECT_THAT(complaint("c.txt", "# two\n1 PINHOLE 640 480 5 5 3 2\n2 PINHOLE 640 480 5 5 3 2\n"),
              AllOf(HasSubstr("c.txt:3"), HasSubstr("2 cameras; expected one")));
  EXPECT_THAT(complaint("c.txt", "1 PINHOLE 640 0 5 5 3 2\n"), HasSubstr("image size 640x0"));
}

}  // namespace
}  // namespace dsorb
