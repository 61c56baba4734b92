// SPDX-License-Identifier: BSD-3-Clause
#include "image/frame_check.h"

#include "dsorb/camera/row_times.h"

#include <gmock/gmock.h>

#include <cmath>
#include <functional>
#include <memory>
#include <stdexcept>
#include <utility>
#include <vector>

namespace dsorb {
namespace {

using ::testing::HasSubstr;

constexpr PinholeCamera kCheckedCamera{40, 40, 15.5, 15.5, 32, 32};

FramePtr frameOf(int id, double timestamp, double exposure = 1, int side = 32) {
  const std::vector<float> pixels(static_cast<std::size_t>(side * side), 100);
  return Frame::create({pixels.data(), side, side}, {FrameId{id}, timestamp, exposure, nullptr});
}

std::string errorOf(const std::function<void()>& call) {
  try {
    call();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "no std::invalid_argument";
}

TEST(FrameCheck, RefusesAnImpossibleCamera) {
  const auto error_of = [](double PinholeCamera::*member, double value) {
    PinholeCamera camera = kCheckedCamera;
    camera.*member = value;
    return errorOf([&camera] { (void)FrameCheck(camera); });
  };
  EXPECT_EQ(error_of(&PinholeCamera::fx, 0), "camera: fx = 0; expected a focal length in pixels");
  EXPECT_THAT(error_of(&PinholeCamera::fx, -40), HasSubstr("fx = -40"));
  EXPECT_THAT(error_of(&PinholeCamera::fy, NAN), HasSubstr("fy = nan"));
  EXPECT_THAT(error_of(&PinholeCamera::cx, INFINITY), HasSubstr("cx = inf"));
  EXPECT_THAT(error_of(&PinholeCamera::cy, NAN), HasSubstr("cy = nan"));
  EXPECT_THAT(errorOf([] { (void)FrameCheck(PinholeCamera()); }), HasSubstr("width = 0"));
  const PinholeCamera tiny{9, 9, 7, 7, 15, 15};  // no Frame is so small
  EXPECT_THAT(errorOf([&] { (void)FrameCheck(tiny); }), HasSubstr("at least 16 pixels"));
}

TEST(FrameCheck, RefusesASizeThatLeavesTooFewPyramidLevels) {
  const auto error_of = [](int width, int height) {
    const PinholeCamera camera{400, 400, 0.5 * width, 0.5 * height, width, height};
    return errorOf([&camera] { (void)FrameCheck(camera); });
  };
  EXPECT_THAT(error_of(641, 481),
              HasSubstr("size 641x481 halves to 1 pyramid levels instead of 4; "
                        "crop images and camera to 640x480"));
  EXPECT_THAT(error_of(1226, 370), HasSubstr("crop images and camera to 1216x368"));
  for (const auto& [width, height] : {std::pair(640, 480), {640, 360}, {752, 480}, {17, 33}}) {
    EXPECT_EQ(error_of(width, height), "no std::invalid_argument") << width << "x" << height;
  }
}

TEST(FrameCheck, RefusesWhatCannotBeTheNextFrame) {
  FrameCheck check(kCheckedCamera);
  const auto error_of = [&check](const FramePtr& frame) {
    return errorOf([&] { check.accept(frame); });
  };
  EXPECT_EQ(error_of(nullptr), "frame is null");
  EXPECT_THAT(error_of(frameOf(0, 0, 1, 16)),
              HasSubstr("size 16x16 differs from the camera's 32x32"));
  EXPECT_THAT(error_of(frameOf(0, NAN)), HasSubstr("timestamp is not finite"));
  for (const double exposure : {0.0, -0.01, std::nan("")}) {
    EXPECT_THAT(error_of(frameOf(0, 0, exposure)), HasSubstr("expected a positive time"));
  }
  check.accept(frameOf(4, 2.5));
  EXPECT_THAT(error_of(frameOf(4, 2.6)), HasSubstr("frame 4: an earlier frame has the same id"));
  EXPECT_THAT(error_of(frameOf(5, 2.5)), HasSubstr("2.500000 after 2.500000: equal"));
  check.accept(frameOf(5, 2.4));
  EXPECT_THAT(error_of(frameOf(6, 2.6)), HasSubstr("time has changed its direction"));
  EXPECT_THAT(error_of(frameOf(4, 2.3)), HasSubstr("frame 4: an earlier frame has the same id"));
  check.accept(frameOf(6, 2.3));
  const std::vector<float> grey(std::size_t{32} * 32, 100);
  const FramePtr rolling = Frame::create(
      {grey.data(), 32, 32}, {FrameId{7}, 2.2, 1, nullptr, std::make_shared<const RowTimes>()});
  EXPECT_THAT(error_of(rolling), HasSubstr("frame 7: has row times; those before have none"));
}

TEST(FrameCheck, AfterARestartTimeMayBeAny) {
  FrameCheck check(kCheckedCamera);
  check.accept(frameOf(4, 2.5));
  check.accept(frameOf(5, 2.4));
  check.restart();
  check.accept(frameOf(5, 2.6));
  check.accept(frameOf(6, 2.7));
}

}  // namespace
}  // namespace dsorb
