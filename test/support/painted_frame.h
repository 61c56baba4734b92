// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/frame.h"

#include "base/random.h"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <functional>
#include <vector>

namespace dsorb {

/// Intensity at a pixel [grey levels].
using Paint = std::function<float(float x, float y)>;

/// Frame of an intensity function, 0.1 s after the frame of the id before.
inline FramePtr paintFrame(int id, int width, int height, const Paint& intensity) {
  std::vector<float> pixels;
  pixels.reserve(static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  for (int y = 0; y < height; ++y) {
    for (int x = 0; x < width; ++x) {
      pixels.push_back(intensity(static_cast<float>(x), static_cast<float>(y)));
    }
  }
  return Frame::create({pixels.data(), width, height}, {FrameId{id}, 0.1 * id, 1, nullptr});
}

/// Smooth random blobs; the seed makes the scene.
inline Paint blobs(std::uint64_t seed) {
  struct Wave {
    float kx, ky, phase;
  };
  Random random(seed);
  std::vector<Wave> waves(24);
  for (Wave& wave : waves) {
    wave = {static_cast<float>(random.uniform(-0.6, 0.6)),
            static_cast<float>(random.uniform(-0.6, 0.6)),
            static_cast<float>(random.uniform(0, 6.28))};
  }
  return [waves](float x, float y) {
    float sum = 0;
    for (const Wave& wave : waves) sum += std::sin(wave.kx * x + wave.ky * y + wave.phase);
    return std::clamp(128.0F + 20.0F * sum, 1.0F, 254.0F);
  };
}

inline Paint shifted(const Paint& scene, float dx, float dy) {
  return [scene, dx, dy](float x, float y) { return scene(x - dx, y - dy); };
}

}  // namespace dsorb
