// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/io/calibration_reader.h"

#include "dsorb/error.h"

#include "support/real_data.h"
#include "support/temporary_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>
#include <sys/stat.h>

#include <fstream>
#include <string>
#include <thread>

namespace dsorb {
namespace {

using testing::AllOf;
using testing::HasSubstr;

class CalibrationReaderTest : public testing::Test {
 protected:
  std::filesystem::path write(const std::string& name, const std::string& text) {
    const auto file = folder_.path() / name;
    std::ofstream(file, std::ios::binary) << text;
    return file;
  }
  Calibration camera(const std::string& text) { return readCalibration(write("camera.txt", text)); }

  /// Message of the IoError that a function throws.
  template <typename Function>
  static std::string complaint(const Function& function) {
    try {
      function();
    } catch (const IoError& error) {
      return error.what();
    }
    return "nothing was thrown";
  }
  std::string cameraComplaint(const std::string& text) {
    return complaint([&] { camera(text); });
  }
  std::string yamlComplaint(const std::string& text) {
    return complaint([&] { readCalibration(write("sensor.yaml", text)); });
  }

  TemporaryFolder folder_;
};

constexpr const char* kTail = "\n640 480\ncrop\n640 480\n";

TEST_F(CalibrationReaderTest, AbsoluteNumbersStayAsWritten) {
  const Calibration c = camera("Pinhole 528 529 325.3 236.6 0\n640 480\nnone\n640 480\n");
  EXPECT_EQ(c.lens.model, LensModel::kPinhole);
  EXPECT_EQ(c.lens.fx, 528);
  EXPECT_EQ(c.lens.fy, 529);
  EXPECT_EQ(c.lens.cx, 325.3);
  EXPECT_EQ(c.lens.cy, 236.6);
  EXPECT_EQ(c.lens.width, 640);
  EXPECT_EQ(c.lens.height, 480);
  EXPECT_EQ(c.rectification.mode, RectificationMode::kNone);
}

TEST_F(CalibrationReaderTest, RelativeNumbersAreScaledAndShiftedByHalfAPixel) {
  const Calibration c = camera(std::string("FOV 0.8 1.2 0.5 0.5 0.9") + kTail);
  EXPECT_DOUBLE_EQ(c.lens.fx, 0.8 * 640);
  EXPECT_DOUBLE_EQ(c.lens.fy, 1.2 * 480);
  EXPECT_DOUBLE_EQ(c.lens.cx, 319.5);
  EXPECT_DOUBLE_EQ(c.lens.cy, 239.5);
  EXPECT_EQ(c.lens.coefficients[0], 0.9);  // distortion is never scaled
}

TEST_F(CalibrationReaderTest, EveryFormOfTheFirstLineIsUnderstood) {
  const struct {
    const char* line;
    LensModel model;
    std::array<double, 8> coefficients;
  } forms[] = {
      {"500 500 320 240 0", LensModel::kPinhole, {}},
      {"500 500 320 240 0.9", LensModel::kFov, {0.9}},
      {"500 500 320 240 1 2 3 4", LensModel::kRadTan, {1, 2, 3, 4}},
      {"Pinhole 500 500 320 240", LensModel::kPinhole, {}},
      {"FOV 500 500 320 240 0.9", LensModel::kFov, {0.9}},
      {"RadTan 500 500 320 240 1 2 3 4", LensModel::kRadTan, {1, 2, 3, 4}},
      {"RadTan 500 500 320 240 1 2 3 4 5", LensModel::kRadTan, {1, 2, 3, 4, 5}},
      {"EquiDistant 500 500 320 240 1 2 3 4", LensModel::kEquidistant, {1, 2, 3, 4}},
      {"KannalaBrandt 500 500 320 240 1 2 3 4", LensModel::kEquidistant, {1, 2, 3, 4}},
      {"Rational 500 500 320 240 1 2 3 4 5 6 7 8", LensModel::kRational, {1, 2, 3, 4, 5, 6, 7, 8}},
      {"DoubleSphere 500 500 320 240 -0.2 0.6", LensModel::kDoubleSphere, {-0.2, 0.6}},
      {"EUCM 500 500 320 240 0.6 1.1", LensModel::kExtendedUnified, {0.6, 1.1}},
      {"Unified 500 500 320 240 2 1 2 3 4", LensModel::kUnified, {2, 1, 2, 3, 4}},
  };
  for (const auto& form : forms) {
    const Calibration c = camera(std::string(form.line) + kTail);
    EXPECT_EQ(c.lens.model, form.model) << form.line;
    EXPECT_EQ(c.lens.coefficients, form.coefficients) << form.line;
    EXPECT_EQ(c.lens.fx, 500) << form.line;
  }
}

TEST_F(CalibrationReaderTest, ExplicitOutputIsAlwaysRelative) {
  const Calibration c =
      camera("Pinhole 0.5 0.6 0.5 0.4 0\n1280 1024\n0.4 0.53 0.5 0.25 0\n640 480\n");
  EXPECT_EQ(c.rectification.mode, RectificationMode::kExplicit);
  EXPECT_EQ(c.rectification.width, 640);
  EXPECT_EQ(c.rectification.height, 480);
  EXPECT_DOUBLE_EQ(c.rectification.camera.fx, 0.4 * 640);
  EXPECT_DOUBLE_EQ(c.rectification.camera.fy, 0.53 * 480);
  EXPECT_DOUBLE_EQ(c.rectification.camera.cx, 319.5);
  EXPECT_DOUBLE_EQ(c.rectification.camera.cy, 119.5);
}

TEST_F(CalibrationReaderTest, WhiteSpaceCarriageReturnsAndEmptyLinesDoNotMatter) {
  const Calibration c = camera(
      "# a comment\r\n \tPinhole  500 500 320 240 0 \r\n\r\n640 480 \r\n full\t\r\n320 240\r\n");
  EXPECT_EQ(c.rectification.mode, RectificationMode::kFull);
  EXPECT_EQ(c.rectification.width, 320);
}

TEST_F(CalibrationReaderTest, MissingOutputLinesMeanTheInputSize) {
  const Calibration three = camera("FOV 500 500 320 240 0.9\n650 480\ncrop\n");
  EXPECT_EQ(three.rectification.mode, RectificationMode::kCrop);
  EXPECT_EQ(three.rectification.width, 650);
  EXPECT_EQ(three.rectification.height, 480);
  EXPECT_EQ(camera("FOV 500 500 320 240 0.9\n650 480").rectification.mode,
            RectificationMode::kCrop);
  EXPECT_EQ(camera("Pinhole 500 500 320 240 0\n650 480").rectification.mode,
            RectificationMode::kNone);
}

TEST_F(CalibrationReaderTest, ComplaintsNameFileLineAndExpectation) {
  EXPECT_THAT(complaint([&] { readCalibration(folder_.path() / "none.txt"); }),
              AllOf(HasSubstr("none.txt"), HasSubstr("cannot be opened")));
  EXPECT_THAT(cameraComplaint(""), HasSubstr("is empty"));
  EXPECT_THAT(cameraComplaint(std::string("RadTan 500 500 320 240 1 2 3") + kTail),
              AllOf(HasSubstr("camera.txt:1"), HasSubstr("7 numbers"), HasSubstr("k1 k2 p1 p2")));
  EXPECT_THAT(cameraComplaint(std::string("500 500 320 240 1 2") + kTail),
              AllOf(HasSubstr("camera.txt:1"), HasSubstr("expected 5")));
  EXPECT_THAT(cameraComplaint(std::string("ocam 500 500 320 240 0") + kTail),
              AllOf(HasSubstr("'ocam' is no lens model"), HasSubstr("Pinhole")));
  EXPECT_THAT(cameraComplaint(std::string("Pinhole nan 500 320 240 0") + kTail),
              AllOf(HasSubstr("camera.txt:1"), HasSubstr("'nan', is not a finite number")));
  EXPECT_THAT(cameraComplaint(std::string("Pinhole 500 -500 320 240 0") + kTail),
              AllOf(HasSubstr("camera.txt:1"), HasSubstr("500 -500"), HasSubstr("positive")));
  EXPECT_THAT(cameraComplaint(std::string("Pinhole 500 500 3200 240 0") + kTail),
              AllOf(HasSubstr("camera.txt:1"), HasSubstr("3200"), HasSubstr("inside the image")));
  EXPECT_THAT(cameraComplaint(std::string("FOV 500 500 320 240 3.5") + kTail),
              AllOf(HasSubstr("camera.txt:1"), HasSubstr("omega 3.5")));
  EXPECT_THAT(cameraComplaint("Pinhole 500 500 320 240 0\n"), HasSubstr("input width and height"));
  EXPECT_THAT(cameraComplaint("Pinhole 500 500 320 240 0\n640 -480\ncrop"),
              AllOf(HasSubstr("camera.txt:2"), HasSubstr("positive whole numbers")));
  EXPECT_THAT(cameraComplaint("Pinhole 500 500 320 240 0\n640\ncrop"), HasSubstr("camera.txt:2"));
  EXPECT_THAT(cameraComplaint("Pinhole 500 500 320 240 0\n640 480\nCrop\n640 480"),
              AllOf(HasSubstr("camera.txt:3"), HasSubstr("crop, full, none")));
  EXPECT_THAT(cameraComplaint("Pinhole 500 500 320 240 0\n640 480\n0.5 0.5 0.5 0.5\n640 480"),
              AllOf(HasSubstr("camera.txt:3"), HasSubstr("4 numbers")));
  EXPECT_THAT(cameraComplaint("Pinhole 500 500 320 240 0\n640 480\n500 500 320 240 0\n640 480"),
              AllOf(HasSubstr("camera.txt:3"), HasSubstr("relative")));
  EXPECT_THAT(
      cameraComplaint("Pinhole 500 500 320 240 .9\n640 480\nnone\n640 480"),
      AllOf(HasSubstr("camera.txt:1"), HasSubstr("omega is 0.9"), HasSubstr("no distortion")));
  EXPECT_THAT(cameraComplaint("Pinhole 500 500 320 240 0\n640 480\n.5 .5 .5 .5 .9\n640 480"),
              AllOf(HasSubstr("camera.txt:3"), HasSubstr("0 for no distortion")));
  EXPECT_THAT(cameraComplaint("Pinhole 500 500 320 240 0\n640 480\nnone\n320 240"),
              AllOf(HasSubstr("camera.txt:4"), HasSubstr("640x480"), HasSubstr("320x240")));
  EXPECT_THAT(cameraComplaint("Pinhole 500 500 320 240 0\n640 480\ncrop\n640 x"),
              AllOf(HasSubstr("camera.txt:4"), HasSubstr("'x', is not a finite number")));
  EXPECT_THAT(cameraComplaint("Pinhole 500 500 320 240 0\n640 480\ncrop\n640 480\nmore"),
              HasSubstr("camera.txt:5"));
}

TEST_F(CalibrationReaderTest, KittiLineBelongsToTheImageFolder) {
  const std::string text =
      "P0: 700 0 600 0 0 701 180 0 0 0 1 0\nP2: 710 0 610 45 0 711 181 0.2 0 0 1 0.003\n";
  const auto file = write("calib.txt", text);
  EXPECT_EQ(readCalibration(file, {"", "/kitti/image_0"}).lens.fx, 700);
  const Calibration c = readCalibration(file, {"P2", {}});
  EXPECT_EQ(c.lens.fx, 710);
  EXPECT_EQ(c.lens.fy, 711);
  EXPECT_EQ(c.lens.cx, 610);
  EXPECT_EQ(c.lens.cy, 181);
  EXPECT_EQ(c.lens.width, 0);  // the images say it
  EXPECT_EQ(c.rectification.mode, RectificationMode::kNone);
  EXPECT_THAT(
      complaint([&] {
        readCalibration(file, {"image_1", {}});
      }),
      AllOf(HasSubstr("calib.txt"), HasSubstr("no camera 'image_1'"), HasSubstr("image_2")));
  EXPECT_THAT(complaint([&] { readCalibration(file); }),
              AllOf(HasSubstr("2 cameras"), HasSubstr("--camera: image_0, image_2")));
  EXPECT_THAT(
      complaint([&] { readCalibration(write("calib.txt", "P0: 700 0 600 0 0 701 180 0 0 0 1")); }),
      AllOf(HasSubstr("calib.txt:1"), HasSubstr("11 numbers")));
  EXPECT_THAT(
      complaint([&] { readCalibration(write("calib.txt", "P0: -7 0 6 0 0 701 180 0 0 0 1 0")); }),
      AllOf(HasSubstr("calib.txt:1"), HasSubstr("positive")));
}

TEST_F(CalibrationReaderTest, LastLineMaySayHowLongTheRowsTake) {
  EXPECT_EQ(camera("Pinhole 528 529 325.3 236.6 0\n640 480\n").lens.readout.seconds, 0);
  const Calibration full =
      camera(std::string("Pinhole 528 529 325.3 236.6 0") + kTail + "readout 25\n");
  EXPECT_DOUBLE_EQ(full.lens.readout.seconds, 0.025);
  EXPECT_FALSE(full.lens.columns);
  EXPECT_EQ(full.rectification.mode, RectificationMode::kCrop);
  const Calibration brief =
      camera("Pinhole 528 529 325.3 236.6 0\n640 480\nreadout -17.5 columns\n");
  EXPECT_DOUBLE_EQ(brief.lens.readout.seconds, -0.0175);
  EXPECT_TRUE(brief.lens.columns);
  EXPECT_EQ(brief.rectification.mode, RectificationMode::kNone);
  const Readout unknown =
      camera("Pinhole 528 529 325.3 236.6 0\n640 480\nreadout auto\n").lens.readout;
  EXPECT_EQ(unknown.seconds, 0);
  EXPECT_EQ(unknown.sigma, kUnknownReadout.sigma);
  for (const char* wrong : {"readout", "readout x", "readout 25 rows", "readout 2000"}) {
    EXPECT_THAT(cameraComplaint(std::string("Pinhole 528 529 325.3 236.6 0") + kTail + wrong),
                AllOf(HasSubstr("camera.txt:5"), HasSubstr("readout: milliseconds")))
        << wrong;
  }
}

TEST_F(CalibrationReaderTest, NoneDoesNotLeaveADistortionInTheImages) {
  for (const char* line : {"RadTan 500 500 320 240 -.3 .1 0 0",
                           "500 500 320 240 .9",
                           "FOV 500 500 320 240 .9",
                           "EquiDistant 500 500 320 240 0 0 0 0",
                           "DoubleSphere 500 500 320 240 -.2 .6"}) {
    EXPECT_THAT(cameraComplaint(std::string(line) + "\n640 480\nnone\n640 480\n"),
                AllOf(HasSubstr("camera.txt:3"), HasSubstr("expected crop or full")))
        << line;
  }
  const Calibration zero = camera("RadTan 500 500 320 240 0 0 0 0\n640 480\nnone\n640 480\n");
  EXPECT_EQ(zero.rectification.mode, RectificationMode::kNone);
}

constexpr const char* kSensor =
    "sensor_type: camera\nresolution: [752, 480]\ncamera_model: pinhole\n"
    "intrinsics: [458.6, 457.3, 367.2, 248.4]\ndistortion_model: radial-tangential\n"
    "distortion_coefficients: [-0.28, 0.07, 0.0002, 0.00002]\n";

std::string replaced(std::string text, const std::string& from, const std::string& to) {
  return text.replace(text.find(from), from.size(), to);
}

TEST_F(CalibrationReaderTest, SensorYamlIsCroppedAtTheInputSize) {
  const Calibration c = readCalibration(write("sensor.yaml", kSensor));
  EXPECT_EQ(c.lens.model, LensModel::kRadTan);
  EXPECT_EQ(c.lens.fx, 458.6);
  EXPECT_EQ(c.lens.cy, 248.4);
  EXPECT_EQ(c.lens.width, 752);
  EXPECT_EQ(c.lens.coefficients[2], 0.0002);
  EXPECT_EQ(c.rectification.mode, RectificationMode::kCrop);
  EXPECT_EQ(c.rectification.width, 0);
  const std::string fisheye = replaced(kSensor, "radial-tangential", "equidistant");
  EXPECT_EQ(readCalibration(write("sensor.yaml", fisheye)).lens.model, LensModel::kEquidistant);
}

TEST_F(CalibrationReaderTest, KalibrChainIsUnderstood) {
  const Calibration c = readCalibration(write(
      "camchain.yaml",
      "cam0:\n  camera_model: pinhole\n  intrinsics: [190.9, 190.9, 254.9, 256.9]\n"
      "  distortion_model: equidistant\n  distortion_coeffs: [0.003, 0.0007, -0.002, 0.0002]\n"
      "  resolution: [512, 512]\n"));
  EXPECT_EQ(c.lens.model, LensModel::kEquidistant);
  EXPECT_EQ(c.lens.coefficients[2], -0.002);
}

TEST_F(CalibrationReaderTest, YamlMaySayHowLongTheRowsTake) {
  EXPECT_EQ(readCalibration(write("sensor.yaml", kSensor)).lens.readout.seconds, 0);
  const std::string rolling = std::string(kSensor) + "readout_ms: 25\n";
  EXPECT_DOUBLE_EQ(readCalibration(write("sensor.yaml", rolling)).lens.readout.seconds, 0.025);
  const Lens sideways =
      readCalibration(write("sensor.yaml", std::string(kSensor) + "readout_ms: -25 columns\n"))
          .lens;
  EXPECT_DOUBLE_EQ(sideways.readout.seconds, -0.025);
  EXPECT_TRUE(sideways.columns);
  const std::string unknown = std::string(kSensor) + "readout_ms: auto\n";
  EXPECT_GT(readCalibration(write("sensor.yaml", unknown)).lens.readout.sigma, 0);
  EXPECT_THAT(yamlComplaint(std::string(kSensor) + "readout_ms: fast\n"),
              AllOf(HasSubstr("sensor.yaml:7"), HasSubstr("readout_ms: milliseconds")));
}

TEST_F(CalibrationReaderTest, FilesOfWindowsMayBeginWithAByteOrderMark) {
  const std::string mark = "\xEF\xBB\xBF";
  EXPECT_EQ(camera(mark + "Pinhole 528 529 325.3 236.6 0\r\n640 480\r\n").lens.fx, 528);
  EXPECT_EQ(readCalibration(write("sensor.yaml", mark + kSensor)).lens.fx, 458.6);
}

TEST_F(CalibrationReaderTest, YamlComplaintsNameLineAndKey) {
  EXPECT_THAT(yamlComplaint(replaced(kSensor, "458.6, ", "")),
              AllOf(HasSubstr("sensor.yaml:4"), HasSubstr("intrinsics: 3 numbers")));
  EXPECT_THAT(yamlComplaint(replaced(kSensor, "458.6", ".nan")),
              AllOf(HasSubstr("sensor.yaml:4"), HasSubstr("intrinsics: entry 1")));
  EXPECT_THAT(yamlComplaint(replaced(kSensor, "458.6", "-458.6")),
              AllOf(HasSubstr("sensor.yaml:4"), HasSubstr("positive")));
  EXPECT_THAT(yamlComplaint(replaced(kSensor, "367.2", "-300")),
              AllOf(HasSubstr("sensor.yaml:4"), HasSubstr("principal point -300 248.4")));
  EXPECT_THAT(yamlComplaint(replaced(kSensor, "pinhole", "ocam")),
              AllOf(HasSubstr("sensor.yaml:3"),
                    HasSubstr("'ocam'"),
                    HasSubstr("expected pinhole, omni, ds, eucm")));
  EXPECT_THAT(yamlComplaint(replaced(kSensor, "radial-tangential", "atan")),
              AllOf(HasSubstr("sensor.yaml:5"),
                    HasSubstr("'pinhole atan'"),
                    HasSubstr("expected pinhole radtan")));
  EXPECT_THAT(yamlComplaint(replaced(kSensor, "[752, 480]", "[752.5, 480]")),
              AllOf(HasSubstr("sensor.yaml:2"), HasSubstr("resolution")));
  EXPECT_THAT(yamlComplaint(replaced(kSensor, "resolution: [752, 480]\n", "")),
              AllOf(HasSubstr("sensor.yaml"), HasSubstr("resolution: is missing")));
  EXPECT_THAT(yamlComplaint("a: [1, 2\nb: 3"), HasSubstr("not YAML"));
  EXPECT_THAT(yamlComplaint("just text"), HasSubstr("a mapping"));
}

TEST_F(CalibrationReaderTest, CameraOfAChainMustBeAMapping) {
  EXPECT_THAT(yamlComplaint("cam0: 5\n"),
              AllOf(HasSubstr("sensor.yaml:1"), HasSubstr("cam0: a mapping")));
}

TEST_F(CalibrationReaderTest, ZeroBytesAndHugeFilesAreRefusedBeforeTheyAreRead) {
  EXPECT_THAT(cameraComplaint(std::string("Pinhole 50 50 31.5 23.5 0\n64 4\0", 32)),
              HasSubstr("camera.txt:2: a zero byte"));
  for (const char* name : {"camera.txt", "sensor.yaml"}) {
    const auto file = write(name, "Pinhole 50 50 31.5 23.5 0\n");
    std::filesystem::resize_file(file, std::uintmax_t{1} << 31U);  // sparse
    EXPECT_THAT(complaint([&] { readCalibration(file); }),
                AllOf(HasSubstr(name), HasSubstr("too large")));
  }
}

TEST_F(CalibrationReaderTest, PipesAreReadUnlessNobodyWrites) {
  const std::string pipe = (folder_.path() / "pipe").string();
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  EXPECT_THAT(complaint([&] { readCalibration(pipe); }),
              AllOf(HasSubstr("pipe: "), HasSubstr("nobody writes")));
  std::thread writer([&pipe] {
    std::ofstream(pipe) << "Pinhole 528 529 325.3 236.6 0\n640 480\nnone\n640 480\n";
  });
  EXPECT_EQ(readCalibration(pipe).lens.fy, 529);
  writer.join();
}

std::string responseText(std::size_t entries, double offset = 3, double scale = 0.1) {
  std::string text;
  for (std::size_t i = 0; i < entries; ++i) {
    text += std::to_string(offset + scale * static_cast<double>(i)) + " ";
  }
  return text + "\n";
}

TEST_F(CalibrationReaderTest, ResponseIsNormalised) {
  for (const std::size_t entries : {256U, 4096U}) {
    const auto response = readResponse(write("pcalib.txt", responseText(entries)));
    ASSERT_EQ(response.size(), entries);
    EXPECT_EQ(response.front(), 0);
    EXPECT_EQ(response.back(), 255);
    EXPECT_NEAR(response[100], 255.0 * 100 / static_cast<double>(entries - 1), 1e-3);
  }
}

TEST_F(CalibrationReaderTest, ResponseComplaints) {
  const auto complain = [&](const std::string& text) {
    return complaint([&] { readResponse(write("pcalib.txt", text)); });
  };
  EXPECT_THAT(complain(""), HasSubstr("is empty"));
  EXPECT_THAT(complain(responseText(255)), AllOf(HasSubstr("pcalib.txt:1"), HasSubstr("255")));
  EXPECT_THAT(complain(responseText(256, 3, 0)), HasSubstr("number 2"));
  EXPECT_THAT(complain(responseText(256, 3, -1)), HasSubstr("number 2"));
  EXPECT_THAT(complain("nan " + responseText(256)), HasSubstr("'nan' is not a finite number"));
}

TEST_F(CalibrationReaderTest, VignetteIsNormalisedToItsMaximum) {
  cv::Mat vignette(4, 6, CV_16U, cv::Scalar(20000));
  vignette.at<std::uint16_t>(1, 2) = 40000;
  vignette.at<std::uint16_t>(3, 5) = 0;
  const auto file = folder_.path() / "vignette.png";
  cv::imwrite(file.string(), vignette);
  PhotometricCalibration calibration;
  readVignette(file, calibration);
  EXPECT_EQ(calibration.vignette_width, 6);
  EXPECT_EQ(calibration.vignette_height, 4);
  ASSERT_EQ(calibration.vignette.size(), 24U);
  EXPECT_FLOAT_EQ(calibration.vignette[0], 0.5F);
  EXPECT_FLOAT_EQ(calibration.vignette[8], 1);
  EXPECT_FLOAT_EQ(calibration.vignette[23], 0);
  cv::imwrite(file.string(), cv::Mat(4, 6, CV_8U, cv::Scalar(0)));
  EXPECT_THAT(complaint([&] { readVignette(file, calibration); }), HasSubstr("black"));
}

TEST_F(CalibrationReaderTest, CalibrationsOfRealSequencesAreRead) {
  const auto read = [](const std::string& part) { return readCalibration(realData(part)); };
  if (!std::filesystem::exists(realData(""))) GTEST_SKIP() << "no real data; set DSORB_DATA";
  EXPECT_EQ(read("room_hand/camera.txt").lens.fx, 528);
  EXPECT_EQ(read("tum_rgbd/freiburg1_rpy_part/camera.txt").lens.coefficients[4], 1.163314);
  EXPECT_EQ(read("kitti_odometry/sequences/00/calib.txt").lens.cx, 607.1928);
  EXPECT_EQ(read("euroc/V1_01_easy_flight/mav0/cam0/sensor.yaml").lens.width, 752);
}

}  // namespace
}  // namespace dsorb
