// SPDX-License-Identifier: BSD-3-Clause
// Calibration files of other programs: ROS, OpenCV, COLMAP.
#include "dsorb/error.h"
#include "dsorb/io/calibration_reader.h"

#include "support/temporary_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>

#include <array>
#include <cmath>
#include <fstream>
#include <stdexcept>
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
      {"1 FULL_OPENCV 640 480 500 510 320 240 1 2 3 4 5 6 7 8",
       {LensModel::kRational, 500, 510, 319.5, 239.5, {1, 2, 3, 4, 5, 6, 7, 8}, 640, 480}},
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

std::string chainCamera(int number, double focal, const std::string& topic) {
  return "cam" + std::to_string(number) + ":\n  camera_model: pinhole\n  intrinsics: [" +
         std::to_string(focal) + ", 500, 320, 240]\n  distortion_model: radtan\n" +
         "  distortion_coeffs: [0, 0, 0, 0]\n  resolution: [640, 480]\n  rostopic: " + topic + "\n";
}

TEST_F(CalibrationFormsTest, ACameraOfSeveralIsNeverGuessed) {
  const auto file =
      write("chain.yaml", chainCamera(0, 510, "/a/image") + chainCamera(1, 520, "/b/image"));
  const auto focal = [&](const CameraChoice& choice) {
    return readCalibration(file, choice).lens.fx;
  };
  EXPECT_EQ(focal({"cam1", {}}), 520);
  EXPECT_EQ(focal({"/b/image", {}}), 520);
  EXPECT_EQ(focal({"/b/image/compressed", {}}), 520);
  EXPECT_EQ(focal({"/robot/cam1/image_raw", {}}), 520);
  EXPECT_EQ(focal({"", "/data/mav0/cam1/data.csv"}), 520);
  EXPECT_EQ(focal({"", "/data/cam0.mp4"}), 510);
  EXPECT_EQ(focal({"cam0", "/data/mav0/cam1/data.csv"}), 510);
  for (const CameraChoice& choice : {CameraChoice{"", "/data/images"},
                                     CameraChoice{"", "/cam1/far/up/the/tree/images"},
                                     CameraChoice{"cam2", {}},
                                     CameraChoice{"/c/image", {}}}) {
    EXPECT_THROW((void)focal(choice), IoError);
  }
  EXPECT_THAT(
      complaint("chain.yaml", chainCamera(0, 510, "/a/image") + chainCamera(1, 520, "/b/image")),
      HasSubstr("choose it with --camera: cam0 (/a/image), cam1 (/b/image)"));
  // Where it does not matter nobody needs to choose.
  EXPECT_EQ(lensOf("same.yaml", chainCamera(0, 510, "/a") + chainCamera(1, 510, "/b")).fx, 510);
  const auto one = write("one.yaml", chainCamera(0, 510, "/a/image"));
  EXPECT_EQ(readCalibration(one, {"/remapped", {}}).lens.fx, 510);
  EXPECT_THROW((void)readCalibration(one, {"cam1", {}}), IoError);
  EXPECT_THAT(complaint("svo.yaml", "cameras:\n- camera: 5\n"),
              HasSubstr("svo.yaml:2: cameras[0].camera: a mapping"));
}

TEST_F(CalibrationFormsTest, RegionAndBinningCutTheCalibration) {
  const std::string info =
      "width: 1280\nheight: 960\ndistortion_model: plumb_bob\nd: [0.0, 0.0, 0.0, 0.0, 0.0]\n"
      "k: [528.0, 0.0, 645.3, 0.0, 528.0, 476.6, 0.0, 0.0, 1.0]\nbinning_x: 2\nbinning_y: 1\n"
      "roi:\n  x_offset: 320\n  y_offset: 240\n  height: 480\n  width: 640\n";
  const Calibration calibration = readCalibration(write("info.yaml", info));
  EXPECT_EQ(calibration.lens.width, 320);
  EXPECT_EQ(calibration.lens.height, 480);
  EXPECT_EQ(calibration.lens.fx, 264);
  EXPECT_DOUBLE_EQ(calibration.lens.cx, (325.3 + .5) / 2 - .5);
  EXPECT_DOUBLE_EQ(calibration.lens.cy, 236.6);
  EXPECT_THROW((void)calibrationForSize(calibration, 640, 960), std::invalid_argument);
  EXPECT_THAT(complaint("info.yaml", withReplaced(info, "x_offset: 320", "x_offset: 700")),
              AllOf(HasSubstr("info.yaml:"), HasSubstr("roi.width"), HasSubstr("1280x960")));
  // A region that is the whole sensor says nothing: images may be smaller.
  const std::string whole = withReplaced(withReplaced(info, "binning_x: 2", "binning_x: 0"),
                                         info.substr(info.find("roi:")),
                                         "roi: {x_offset: 0, y_offset: 0, height: 0, width: 0}\n");
  EXPECT_EQ(calibrationForSize(readCalibration(write("info.yaml", whole)), 640, 480).lens.fx, 264);
}

TEST_F(CalibrationFormsTest, KittiRawHasACalibrationForEachSize) {
  const std::string text =
      "S_02: 1392 512\nK_02: 959 0 696 0 956 224 0 0 1\nD_02: -0.3 0.1 0 0 0\n"
      "S_rect_02: 1242 375\nP_rect_02: 721.5 0 609.6 44.8 0 721.5 172.9 0.2 0 0 1 0\n";
  const auto file = write("calib_cam_to_cam.txt", text);
  const Lens rectified = readCalibration(file, {"", "image_02", 1242, 375}).lens;
  expectLens(rectified, {LensModel::kPinhole, 721.5, 721.5, 609.6, 172.9, {}, 1242, 375});
  const Lens raw = readCalibration(file, {"02", {}, 1392, 512}).lens;
  expectLens(raw, {LensModel::kRadTan, 959, 956, 696, 224, {-0.3, 0.1}, 1392, 512});
  EXPECT_EQ(readCalibration(file).lens.fx, 721.5);
}

TEST_F(CalibrationFormsTest, SettingsOfOtherSystemsHoldTheirLens) {
  const auto corpus = [](const std::string& name, const CameraChoice& choice = {}) {
    return readCalibration(std::string(DSORB_CORPUS) + "/" + name, choice).lens;
  };
  const std::string yaml = "calibration_yaml/", json = "calibration_json/";
  const Lens freiburg = {
      LensModel::kRadTan, 528, 529, 325.3, 236.6, {0.26, -0.95, -0.005, 0.002, 1.16}, 640, 480};
  expectLens(corpus(yaml + "orbslam2.yaml"), freiburg);
  expectLens(corpus(yaml + "stella.yaml"), freiburg);
  const Lens second = {LensModel::kEquidistant,
                       191.9,
                       191.8,
                       255.9,
                       257.9,
                       {0.0035, 0.0008, -0.003, 0.0003},
                       512,
                       512};
  expectLens(corpus(yaml + "orbslam3.yaml", {"", "mav0/cam1/data.csv"}), second);
  expectLens(corpus(yaml + "vins_kb.yaml"),
             {LensModel::kEquidistant,
              190.9,
              190.8,
              254.9,
              256.9,
              {0.0034, 0.0007, -0.002, 0.0002},
              512,
              512});
  const Lens vins = corpus(yaml + "vins_pinhole.yaml");
  EXPECT_EQ(vins.coefficients[0], -0.29);
  EXPECT_EQ(vins.readout.seconds, 0.03);
  expectLens(corpus(yaml + "vins_mei.yaml"),
             {LensModel::kUnified, 2178, 2177, 388, 246, {3.6, 0.63, 5.1, 0.003, 0.004}, 752, 480});
  const Lens svo = corpus(yaml + "svo.yaml");
  EXPECT_EQ(svo.cx, 367.2);
  EXPECT_DOUBLE_EQ(svo.readout.seconds, 479 * 30e-6);
  expectLens(corpus(json + "basalt.json", {"cam0", {}}),
             {LensModel::kDoubleSphere, 158.2, 158.3, 254.9, 256.8, {-0.17, 0.59}, 512, 512});
  expectLens(
      corpus(json + "nerfstudio.json"),
      {LensModel::kRadTan, 528, 529, 324.8, 236.1, {-0.1, 0.01, 0.001, 0.002, 0.001}, 640, 480});
  const Lens ngp = corpus(json + "instant_ngp.json");
  EXPECT_DOUBLE_EQ(ngp.fx, 320 / std::tan(0.55));
  EXPECT_EQ(ngp.cx, 319.5);
  expectLens(corpus(yaml + "kalibr_omni.yaml"),
             {LensModel::kUnified,
              1002.5,
              1005.4,
              325.3,
              236.6,
              {2.04, -0.11, 0.45, -0.0004, -0.0003},
              640,
              480});
  expectLens(corpus(yaml + "rational.yaml"),
             {LensModel::kRational,
              528,
              528,
              325.3,
              236.6,
              {0.52, -2.6, 0.0004, -0.0003, 1.5, 0.4, -2.43, 1.43},
              640,
              480});
  EXPECT_THAT(complaint("a.json",
                        "{\"w\": 640, \"w\": 640, \"h\": 480, \"fl_x\": 5, \"cx\": 1, \"cy\": 1}"),
              HasSubstr("w: is there twice"));
  EXPECT_THAT(complaint("a.json", "{\"w\": 640,"), HasSubstr("a.json:1: not YAML"));
  EXPECT_THAT(complaint("a.yaml", "Camera.type: \"Omni\"\nCamera.fx: 5\n"),
              AllOf(HasSubstr("a.yaml:1"), HasSubstr("type: 'Omni'"), HasSubstr("KannalaBrandt8")));
  EXPECT_THAT(complaint("a.yaml", "Camera.fx: 500\nCamera.fy: 500\nCamera.cx: 5\n"),
              HasSubstr("Camera.cy: is missing"));
  EXPECT_THAT(complaint("a.yaml", "cam0_calib: cam0_mei.yaml\n"), HasSubstr("give that one"));
}

TEST_F(CalibrationFormsTest, MatrixComplaintsNameLineAndKey) {
  EXPECT_THAT(complaint("a.yaml", withReplaced(kRos, "0, 0, 1]", "0, 0]")),
              AllOf(HasSubstr("a.yaml:7"), HasSubstr("camera_matrix.data: 8 numbers")));
  EXPECT_THAT(complaint("a.yaml", withReplaced(kRos, "[500, 0,", "[500, 3,")),
              HasSubstr("camera_matrix.data: expected fx 0 cx"));
  EXPECT_THAT(complaint("a.yaml", withReplaced(kRos, "[500,", "[-500,")),
              HasSubstr("camera_matrix.data: focal lengths -500 510"));
  EXPECT_THAT(complaint("a.yaml", withReplaced(kRos, "[500,", "[.nan,")),
              HasSubstr("camera_matrix.data: entry 1, '.nan', is not a finite number"));
  EXPECT_THAT(complaint("a.yaml", withReplaced(kRos, " 320,", " 700,")),
              HasSubstr("principal point 700 240; expected inside the image of 640x480"));
  EXPECT_THAT(complaint("a.yaml", withReplaced(kRos, "plumb_bob", "omni")),
              AllOf(HasSubstr("a.yaml:8"), HasSubstr("'omni'")));
  EXPECT_THAT(complaint("a.yaml", withReplaced(kRos, "0.05]", "0.05, 0, 0, 0, 0.3, 0, 0, 0]")),
              HasSubstr("distortion_coefficients.data: the distortion coefficient s1 is 0.3"));
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
              HasSubstr("K.data: entry 3, 'x', is not a finite number"));
  EXPECT_THAT(
      complaint("a.xml", "<?xml version=\"1.0\"?>\n<opencv_storage>\n<a>1</a></opencv_storage>\n"),
      HasSubstr("a.xml: no calibration that is known here"));
}

TEST_F(CalibrationFormsTest, ColmapComplaintsNameTheLine) {
  EXPECT_THAT(
      complaint("c.txt", "1 THIN_PRISM_FISHEYE 640 480 500 510 320 240 1 2 3 4 5 6 7 8\n"),
      AllOf(HasSubstr("c.txt:1"), HasSubstr("THIN_PRISM_FISHEYE"), HasSubstr("OPENCV_FISHEYE")));
  EXPECT_THAT(complaint("c.txt", "1 OPENCV 640 480 500 510 320 240 1 2 3\n"),
              AllOf(HasSubstr("7 numbers"), HasSubstr("k1 k2 p1 p2")));
  EXPECT_THAT(complaint("c.txt", "# two\n1 PINHOLE 640 480 5 5 3 2\n2 PINHOLE 640 480 6 5 3 2\n"),
              AllOf(HasSubstr("c.txt"), HasSubstr("2 cameras"), HasSubstr("--camera: 1, 2")));
  EXPECT_THAT(complaint("c.txt", "1 PINHOLE 640 0 5 5 3 2\n"), HasSubstr("image size 640x0"));
}

}  // namespace
}  // namespace dsorb
