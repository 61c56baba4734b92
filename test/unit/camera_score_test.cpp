// SPDX-License-Identifier: BSD-3-Clause
#include "support/window_scene.h"
#include "window/window_optimizer.h"
#include "window/window_step.h"

#include <gtest/gtest.h>

#include <limits>

namespace dsorb::window {
namespace {

/// A room's window, adjusted with a focal length that is not its own.
WindowScene adjustedWith(double factor, const WindowOptions& options, OptimizationReport& report) {
  WindowSceneOptions scene_options;
  scene_options.frames = {0, 4, 8, 12, 16, 20, 24, 28};
  scene_options.cell = 10;
  scene_options.prior_variance = 1e-4F;
  WindowScene scene = makeWindowScene(scene_options, options);
  scene.window.first_camera.fx *= factor;
  scene.window.first_camera.fy *= factor;
  for (int i = 0; i < 3; ++i) report = WindowOptimizer(options).optimize(scene.window);
  return scene;
}

TEST(CameraScore, AsksForTheFocalLengthThatIsRight) {
  const WindowOptions options;
  for (const double factor : {0.7, 0.9, 1.0, 1.1}) {
    OptimizationReport report;
    WindowScene scene = adjustedWith(factor, options, report);
    ASSERT_TRUE(report.finite) << factor;
    const CameraScore score = scoreCamera(scene.window, options, report.rms);
    // Measured: 6.1, 10, 0 and 8.3 standard deviations of .04, .009, .009 and .011.
    EXPECT_EQ(score.suspicious(), factor != 1) << factor;
    EXPECT_NEAR(score.radial.k1, 0, 0.01) << factor;  // measured .0022 at most
    if (factor == 1) {
      EXPECT_NEAR(score.focal_change, 0, 0.01);  // measured -.0016
    } else {
      const double least = factor < 0.8 ? 0.5 : 0.8;  // measured .60, .83, 1.01
      EXPECT_GT(score.focal_change / (1 / factor - 1), least) << factor;
    }
  }
}

TEST(CameraScore, LeavesTheWindowAsItIs) {
  const WindowOptions options;
  OptimizationReport report;
  WindowScene once = adjustedWith(1.1, options, report);
  WindowScene twice = once;
  (void)scoreCamera(twice.window, options, report.rms);
  const OptimizationReport after_once = WindowOptimizer(options).optimize(once.window);
  const OptimizationReport after_twice = WindowOptimizer(options).optimize(twice.window);
  EXPECT_EQ(after_once.first_energy, after_twice.first_energy);
  EXPECT_EQ(after_once.last_energy, after_twice.last_energy);
  EXPECT_EQ(once.window.deviation(), twice.window.deviation());
  EXPECT_EQ(once.window.camera_state, twice.window.camera_state);
}

TEST(CameraScore, ContradictsByWhatIsLargeAndSure) {
  EXPECT_EQ((CameraScore{0.1, 0.02, {0, 0.01}}).deviations(), 5);
  EXPECT_EQ((CameraScore{0.029, 0.001, {0.019, 0.001}}).deviations(), 0) << "a right camera may";
  EXPECT_EQ((CameraScore{-0.1, 0.05, {-0.06, 0.01}}).deviations(), 6);
  EXPECT_FALSE((CameraScore{0.3, 0.1, {}}).suspicious());
  const double nan = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ((CameraScore{nan, nan, {nan, nan}}).deviations(), 0);
  EXPECT_EQ((CameraScore{0.3, 0, {}}).deviations(), 0);
}

TEST(CameraScore, SaysHowWrongMotionsMayBe) {
  const PinholeCamera camera{320, 320, 319.5, 239.5, 640, 480};
  EXPECT_EQ((CameraScore{0.3, 0.1, {}}).motionError(camera), 0) << "not suspected";
  EXPECT_EQ((CameraScore{-0.3, 0.01, {}}).motionError(camera), 0.3);
  EXPECT_EQ((CameraScore{-0.3, 0.01, {0.5, 0.5}}).motionError(camera), 0.3) << "not known";
  double sum = 0;  // r^4 over the image
  for (int y = 0; y < 480; ++y) {
    for (int x = 0; x < 640; ++x) {
      sum += std::pow(std::pow((x - 319.5) / 320, 2) + std::pow((y - 239.5) / 320, 2), 2);
    }
  }
  EXPECT_NEAR((CameraScore{0, 0.01, {-0.1, 0.01}}).motionError(camera),
              0.1 * std::sqrt(sum / (640 * 480)),
              1e-4);
}

}  // namespace
}  // namespace dsorb::window
