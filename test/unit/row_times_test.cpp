// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/camera/row_times.h"

#include "camera/lens_models.h"
#include "camera/undistorter.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

namespace dsorb {
namespace {

constexpr double kReadout = 0.025;  // [s]

Lens timedLens() {
  Lens lens{LensModel::kPinhole, 500, 500, 319.5, 239.5, {}, 640, 480};
  lens.readout = {kReadout, 0};
  return lens;
}

TEST(RowTimes, OfAPinholeGrowFromTheFirstRowToTheLast) {
  const RowTimes times = rowTimes(timedLens(), {500, 500, 319.5, 239.5, 640, 480}, false);
  EXPECT_NEAR(times.at(0, 0), -kReadout / 2, 1e-12);
  EXPECT_NEAR(times.at(639, 0), -kReadout / 2, 1e-12);
  EXPECT_NEAR(times.at(320, 239.5), 0, 1e-12);
  EXPECT_NEAR(times.at(13, 479), kReadout / 2, 1e-12);
  EXPECT_NEAR(times.at(600, 100) - times.at(600, 99), kReadout / 479, 1e-12);
}

TEST(RowTimes, RowsThatAreCroppedKeepTheirTimes) {
  Lens lens = timedLens();
  lens.height = 490;
  const RowTimes times = rowTimes(lens, {500, 500, 319.5, 239.5, 640, 480}, false);
  EXPECT_NEAR(times.at(0, 0), -kReadout / 2, 1e-12);
  EXPECT_NEAR(times.at(0, 479), kReadout * (479.0 / 489 - 0.5), 1e-12);
}

TEST(RowTimes, FollowColumnsAndTheOtherDirection) {
  Lens lens = timedLens();
  lens.columns = true;
  lens.readout = {-kReadout, 0};
  const RowTimes times = rowTimes(lens, {500, 500, 319.5, 239.5, 640, 480}, false);
  EXPECT_NEAR(times.at(0, 300), kReadout / 2, 1e-12);
  EXPECT_NEAR(times.at(639, 10), -kReadout / 2, 1e-12);
  lens.backwards = true;
  const RowTimes turned = rowTimes(lens, {500, 500, 319.5, 239.5, 640, 480}, false);
  EXPECT_NEAR(turned.at(639, 10), kReadout / 2, 1e-12);
}

/// Errors of the polynomial over all valid pixels, as a share of the readout.
struct FitErrors {
  double largest = 0;
  double rms = 0;
};

FitErrors fitErrors(Lens lens, RectificationMode mode) {
  lens.readout = {kReadout, 0};
  Rectification rectification;
  rectification.mode = mode;
  const PinholeCamera camera = Undistorter(lens, rectification).camera();
  const RowTimes times = rowTimes(lens, camera, true);
  const double max_radius = monotoneRadius(lens);
  FitErrors errors;
  int count = 0;
  for (int y = 0; y < camera.height; y += 5) {
    for (int x = 0; x < camera.width; x += 5) {
      const Eigen::Vector2d ray = camera.unproject({x, y}).head<2>();
      if (ray.norm() > max_radius) continue;
      const double row = projectThroughLens(lens, ray).y();
      if (row < 0 || row > lens.height - 1) continue;
      const double share = row / (lens.height - 1) - 0.5;
      const double error = times.at(x, y) / kReadout - share;
      errors.largest = std::max(errors.largest, std::abs(error));
      errors.rms += error * error;
      ++count;
    }
  }
  errors.rms = std::sqrt(errors.rms / count);
  return errors;
}

TEST(RowTimes, PolynomialFollowsTheCurvedRowsOfLenses) {
  // EuRoC's cam0 and the lens of TUM-mono.
  const Lens radtan{LensModel::kRadTan,
                    458.654,
                    457.296,
                    367.215,
                    248.375,
                    {-0.28340811, 0.07395907, 0.00019359, 1.76187114e-05, 0},
                    752,
                    480};
  const Lens fov{LensModel::kFov, 448, 558, 639.5, 511.5, {0.9, 0, 0, 0, 0}, 1280, 1024};
  const FitErrors narrow = fitErrors(radtan, RectificationMode::kCrop);
  const FitErrors wide = fitErrors(fov, RectificationMode::kCrop);
  EXPECT_LT(narrow.rms, 0.0035);     // measured .0028
  EXPECT_LT(narrow.largest, 0.025);  // measured .0217, in the corners
  EXPECT_LT(wide.rms, 0.025);        // measured .0206
  EXPECT_LT(wide.largest, 0.08);     // measured .0683
}

}  // namespace
}  // namespace dsorb
