// SPDX-License-Identifier: BSD-3-Clause
// What a mask hides must not matter: not one bit of a result may depend on it.
#include "dsorb/camera/rectifier.h"
#include "dsorb/init/initializer.h"

#include "support/odometry_run.h"
#include "support/published_variants.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

namespace dsorb {
namespace {

constexpr int kFrames = 40;
constexpr int kBonnetTop = 180;  // of 240 rows
constexpr int kStripe = 7;       // [px]

const World& maskedRoom() {
  static const World world(synthetic::SequenceKind::kRoom, kFrames);
  return world;
}

/// Whether a pixel lies on the bonnet: an arch at the lower border.
bool onBonnet(int x, int y) {
  const double off = (x - 160) / 160.0;
  return y > kBonnetTop + 40 * off * off;
}

/// Bright checks that move over the bonnet by themselves.
std::uint8_t reflection(int x, int y, int index) {
  return ((x + 5 * index) / kStripe + (y - 3 * index + 1000) / kStripe) % 2 == 0 ? 250 : 130;
}

std::vector<std::uint8_t> bonnetMask() {
  std::vector<std::uint8_t> mask;
  for (int y = 0; y < maskedRoom().camera().height; ++y) {
    for (int x = 0; x < maskedRoom().camera().width; ++x) mask.push_back(onBonnet(x, y) ? 0 : 255);
  }
  return mask;
}

/// The images of the room in whole grey levels, with or without reflections on the bonnet.
std::vector<FramePtr> frames(bool with_reflections, bool with_mask) {
  const PinholeCamera& camera = maskedRoom().camera();
  Calibration calibration;
  calibration.lens = {LensModel::kPinhole,
                      camera.fx,
                      camera.fy,
                      camera.cx,
                      camera.cy,
                      {},
                      camera.width,
                      camera.height};
  calibration.rectification.mode = RectificationMode::kNone;
  Rectifier rectifier(calibration);
  const std::vector<std::uint8_t> mask = bonnetMask();
  if (with_mask) rectifier.setMask({mask.data(), camera.width, camera.height});
  std::vector<FramePtr> result;
  for (const FramePtr& rendered : maskedRoom().frames()) {
    const int index = rendered->id().value;
    std::vector<std::uint8_t> image;
    for (int y = 0; y < camera.height; ++y) {
      for (int x = 0; x < camera.width; ++x) {
        const float level = std::clamp(rendered->level(0).at(x, y).intensity, 0.0F, 255.0F);
        image.push_back(with_reflections && onBonnet(x, y)
                            ? reflection(x, y, index)
                            : static_cast<std::uint8_t>(std::lround(level)));
      }
    }
    result.push_back(
        rectifier.frame({image.data(), camera.width, camera.height, PixelFormat::kGrey8, 0},
                        {rendered->id(), rendered->timestamp()}));
  }
  return result;
}

const std::vector<FramePtr>& plain() {
  static const std::vector<FramePtr> masked = frames(false, true);
  return masked;
}
const std::vector<FramePtr>& disturbed() {
  static const std::vector<FramePtr> masked = frames(true, true);
  return masked;
}

std::optional<InitializationResult> start(const std::string& variant,
                                          const std::vector<FramePtr>& images) {
  const auto initializer = makeInitializer(initializerVariant(variant), maskedRoom().camera());
  for (const FramePtr& frame : images) {
    InitStep step = initializer->addFrame(frame);
    if (step.result) return step.result;
  }
  return std::nullopt;
}

class MaskedStart : public testing::TestWithParam<std::string> {};

TEST_P(MaskedStart, DoesNotKnowWhatTheMaskHides) {
  const auto expected = start(GetParam(), plain());
  const auto result = start(GetParam(), disturbed());
  ASSERT_TRUE(expected);
  ASSERT_TRUE(result);
  ASSERT_EQ(result->frames.size(), expected->frames.size());
  ASSERT_EQ(result->points.size(), expected->points.size());
  for (std::size_t i = 0; i < result->frames.size(); ++i) {
    ASSERT_EQ(result->frames[i].T_cam_ref.has_value(), expected->frames[i].T_cam_ref.has_value());
    if (!result->frames[i].T_cam_ref) continue;
    EXPECT_EQ(result->frames[i].T_cam_ref->matrix(), expected->frames[i].T_cam_ref->matrix());
  }
  for (std::size_t i = 0; i < result->points.size(); ++i) {
    const InitPoint& point = result->points[i];
    EXPECT_EQ(point.pixel, expected->points[i].pixel);
    EXPECT_EQ(point.inverse_depth, expected->points[i].inverse_depth);
    EXPECT_EQ(point.variance, expected->points[i].variance);
    EXPECT_FALSE(onBonnet(static_cast<int>(std::lround(point.pixel.x())),
                          static_cast<int>(std::lround(point.pixel.y()))));
  }
}

INSTANTIATE_TEST_SUITE_P(Initializers,
                         MaskedStart,
                         testing::ValuesIn(initializerVariants()),
                         [](const auto& variant) {
                           std::string name = variant.param;
                           std::replace(name.begin(), name.end(), '-', '_');
                           return name;
                         });

Recorder recorded(const std::vector<FramePtr>& images) {
  Recorder recorder;
  Odometry odometry(maskedRoom().camera(), OdometryOptions());
  odometry.addObserver(&recorder);
  for (const FramePtr& frame : images) {
    if (odometry.process(frame).state == OdometryState::kLost) break;
  }
  odometry.finish();
  return recorder;
}

/// Whether two runs gave the same bits for every frame.
bool same(const Recorder& a, const Recorder& b) {
  if (a.events != b.events) return false;
  for (std::size_t i = 0; i < a.estimates.size(); ++i) {
    const auto& left = a.estimates[i].T_world_cam;
    const auto& right = b.estimates[i].T_world_cam;
    if (left.has_value() != right.has_value()) return false;
    if (left && left->matrix() != right->matrix()) return false;
  }
  return true;
}

TEST(MaskedOdometry, DoesNotKnowWhatTheMaskHides) {
  const Recorder expected = recorded(plain());
  EXPECT_EQ(expected.estimates.back().state, OdometryState::kTracked);
  EXPECT_TRUE(same(recorded(disturbed()), expected));
  EXPECT_FALSE(same(recorded(frames(true, false)), expected)) << "without mask it matters";
  for (const KeyframeSnapshot& keyframe : expected.keyframes) {
    for (const MapPoint& point : keyframe.points) {
      EXPECT_FALSE(onBonnet(static_cast<int>(std::lround(point.pixel.x())),
                            static_cast<int>(std::lround(point.pixel.y()))));
    }
  }
}

}  // namespace
}  // namespace dsorb
