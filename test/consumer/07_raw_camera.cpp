// SPDX-License-Identifier: BSD-3-Clause
// From colour images with nanoseconds to the first poses; the bottom of the image is masked.
#include "images.h"

#include <dsorb/camera/rectifier.h>
#include <dsorb/init/initializer.h>

#include <cstdio>

namespace {

/// As a camera driver gives them: blue, green, red.
std::vector<std::uint8_t> colourImage(int index) {
  std::vector<std::uint8_t> bgr;
  for (const std::uint8_t grey : grabImage(index)) bgr.insert(bgr.end(), 3, grey);
  return bgr;
}

}  // namespace

int main() {
  dsorb::Calibration calibration;  // or dsorb::readCalibration("camera.yaml") of dsorb::io
  calibration.lens = {dsorb::LensModel::kRadTan,
                      kFocal,
                      kFocal,
                      kWidth / 2.0,
                      kHeight / 2.0,
                      {0, 0, 0, 0, 0},  // k1 k2 p1 p2 k3
                      kWidth,
                      kHeight};
  dsorb::Rectifier rectifier(calibration);
  std::vector<std::uint8_t> mask(kWidth * kHeight, 255);
  std::fill(mask.end() - 20 * kWidth, mask.end(), 0);  // the bonnet
  rectifier.setMask({mask.data(), kWidth, kHeight});

  const auto initializer = dsorb::makeInitializer(dsorb::InitializerOptions(), rectifier.camera());
  for (int i = 0; i < 30; ++i) {
    const auto image = colourImage(i);
    const std::int64_t nanoseconds = 1403636579763555584 + i * std::int64_t{33333333};
    const dsorb::RawImage raw{image.data(), kWidth, kHeight, dsorb::PixelFormat::kBgr8, 0};
    const auto step = initializer->addFrame(
        rectifier.frame(raw, {dsorb::FrameId{i}, dsorb::secondsFromNanoseconds(nanoseconds)}));
    if (!step.result) continue;
    for (const dsorb::InitPoint& point : step.result->points) {
      if (point.pixel.y() > kHeight - 20) return 1;  // nothing is found under the mask
    }
    std::printf("initialized with frame %d: %zu points\n", i, step.result->points.size());
    return 0;
  }
  std::puts("not initialized");
  return 1;
}
