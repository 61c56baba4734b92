// SPDX-License-Identifier: BSD-3-Clause
#include "io/input/gyroscope.h"

#include "dsorb/error.h"

#include "support/temporary_folder.h"

#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <string>

namespace dsorb {
namespace {

constexpr double kRate = .7;  // [rad/s]

class GyroscopeTest : public testing::Test {
 protected:
  std::filesystem::path write(const std::string& text) {
    const std::filesystem::path file = folder_.path() / "gyro.csv";
    std::ofstream(file) << text;
    return file;
  }
  /// A hundred lines a second about the gyroscope's x, with a gap after the second second.
  std::filesystem::path turning() {
    std::string text = "#timestamp [ns],w_RS_S_x,w_RS_S_y,w_RS_S_z,a_x\n";
    for (int i = 0; i <= 400; ++i) {
      if (i > 200 && i < 250) continue;
      text += std::to_string(1400000000000000000LL + i * 10000000LL) + "," + std::to_string(kRate) +
              ",0,0,9.81\n";
    }
    return write(text);
  }
  TemporaryFolder folder_;
};

TEST_F(GyroscopeTest, TurnsAsItsRatesSayInTheCamerasAxes) {
  const Eigen::Matrix3d R_cam_gyro = *parseRotation("0 0 1, 1 0 0, 0 1 0");  // its x is our y
  const Gyroscope gyroscope(turning(), R_cam_gyro);
  const auto prior = gyroscope.between(FrameId{4}, 1400000000.503, 1400000000.737);
  ASSERT_TRUE(prior);
  EXPECT_EQ(prior->since, FrameId{4});
  EXPECT_FALSE(prior->has_translation);
  const Eigen::Vector3d turn = so3Log(prior->T_frame_since.unitQuaternion());
  EXPECT_NEAR((turn - Eigen::Vector3d(0, -kRate * .234, 0)).norm(), 0, 1e-6)
      << "directions turn against the camera";
  const auto back = gyroscope.between(FrameId{4}, 1400000000.737, 1400000000.503);
  EXPECT_NEAR((back->T_frame_since.rotationMatrix() * prior->T_frame_since.rotationMatrix() -
               Eigen::Matrix3d::Identity())
                  .norm(),
              0,
              1e-9);
}

TEST_F(GyroscopeTest, SaysNothingAcrossAGapOrBeyondItsEnds) {
  const Gyroscope gyroscope(turning(), Eigen::Matrix3d::Identity());
  EXPECT_FALSE(gyroscope.between(FrameId{0}, 1400000001.9, 1400000002.1));
  EXPECT_FALSE(gyroscope.between(FrameId{0}, 1399999999.9, 1400000000.1));
  EXPECT_FALSE(gyroscope.between(FrameId{0}, 1400000003.9, 1400000004.1));
  EXPECT_FALSE(gyroscope.between(FrameId{0}, 1400000001, 1400000001));
  EXPECT_TRUE(gyroscope.between(FrameId{0}, 1400000003.9, 1400000004));
}

TEST_F(GyroscopeTest, NamesTheLineThatIsWrong) {
  const auto message = [&](const std::string& text) -> std::string {
    try {
      (void)Gyroscope(write(text), Eigen::Matrix3d::Identity());
    } catch (const IoError& error) {
      return error.what();
    }
    return "nothing";
  };
  EXPECT_NE(message("t,x,y,z\n0,1,2\n").find("gyro.csv:2: expected time, wx, wy, wz"),
            std::string::npos);
  EXPECT_NE(message("0,1,2,3\n0,1,2,3\n").find("gyro.csv:2: its time is not after"),
            std::string::npos);
  EXPECT_NE(message("0,1,2,x\n").find("gyro.csv:1: 'x' is not a finite number"), std::string::npos);
  EXPECT_NE(message("0,1,2,3\n").find("two or more lines"), std::string::npos);
  EXPECT_FALSE(parseRotation("1 0 0 0 1 0 0 0 -1"));
  EXPECT_FALSE(parseRotation("1 0 0 0 1 0 0 0"));
}

}  // namespace
}  // namespace dsorb
