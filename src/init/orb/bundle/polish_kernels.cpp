// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/bundle/polish_kernels.h"

#include "base/lanes.h"
#include "base/target_clones.h"
#include "estimate/robust_loss.h"
#include "estimate/sampling.h"

#include <cmath>

namespace dsorb::init_orb {
namespace {

constexpr int kRadius = kPolishSide / 2;

/// Offsets of the samples from the centre [px], and 1 for each; zeros fill up.
struct Offsets {
  std::array<float, kPolishLanes> x{};
  std::array<float, kPolishLanes> y{};
  std::array<float, kPolishLanes> used{};
};

constexpr Offsets makeOffsets() {
  Offsets offsets;
  for (std::size_t i = 0; i < kPolishPixels; ++i) {
    const int index = static_cast<int>(i);
    const int row = index / kPolishSide;
    offsets.x[i] = static_cast<float>(kPolishStep * (index - row * kPolishSide - kRadius));
    offsets.y[i] = static_cast<float>(kPolishStep * (row - kRadius));
    offsets.used[i] = 1;
  }
  return offsets;
}

constexpr Offsets kOffsets = makeOffsets();

DSORB_TARGET_CLONES bool linearizeInLanes(const PolishFrame& f,
                                          const PolishPatch& patch,
                                          const float* direction,
                                          Lanes& totals) {
  Lanes terms[8] = {};
  const auto max_x = static_cast<float>(f.width - 2);
  const auto max_y = static_cast<float>(f.height - 2);
  for (std::size_t i = 0; i < kPolishLanes; i += kLanes) {
    Lanes offset_x;
    Lanes offset_y;
    Lanes used;
    Lanes grey;
    load(&kOffsets.x[i], offset_x);
    load(&kOffsets.y[i], offset_y);
    load(&kOffsets.used[i], used);
    load(&patch.grey[i], grey);
    const Lanes px = direction[0] + offset_x * f.by_x[0] + offset_y * f.by_y[0];
    const Lanes py = direction[1] + offset_x * f.by_x[1] + offset_y * f.by_y[1];
    const Lanes pz = direction[2] + offset_x * f.by_x[2] + offset_y * f.by_y[2];
    const Lanes inverse_z = 1.0F / pz;
    const Lanes x = f.fx * px * inverse_z + f.cx;
    const Lanes y = f.fy * py * inverse_z + f.cy;
    // Written so that NaN is outside.
    const auto inside = (pz > 0.0F) & (x >= 1.0F) & (y >= 1.0F) & (x < max_x) & (y < max_y);
    int all = -1;
    for (int k = 0; k < kLanes; ++k) all &= inside[k];
    if (all == 0) return false;
    LaneSamples samples;
    interpolateLanes(f.image, f.width, x, y, samples);
    const Lanes residual = (samples.intensity - f.gain * grey - f.offset) * used;
    const Lanes magnitude = residual < 0.0F ? -residual : residual;
    Lanes threshold;
    fill(f.huber_threshold, threshold);
    Lanes weight;
    huberWeights(magnitude, threshold, weight);
    weight *= used;
    const Lanes wx = weight * samples.dx;
    const Lanes wy = weight * samples.dy;
    terms[0] += wx * samples.dx;
    terms[1] += wx * samples.dy;
    terms[2] += wy * samples.dy;
    terms[3] += wx * residual;
    terms[4] += wy * residual;
    terms[5] += weight * residual * residual;
    terms[6] += weight;
    terms[7] += magnitude;
  }
  sumLanes(terms, totals);
  return true;
}

}  // namespace

PolishPatch cutPolishPatch(const PyramidLevel& reference, float x, float y) {
  PolishPatch patch;
  if (!insideForInterpolation(reference, x, y, static_cast<float>(kPolishStep * kRadius))) {
    return patch;
  }
  float sum = 0;
  for (std::size_t i = 0; i < kPolishPixels; ++i) {
    patch.grey[i] = interpolateIntensity(reference, x + kOffsets.x[i], y + kOffsets.y[i]);
    sum += patch.grey[i];
  }
  patch.valid = std::isfinite(sum);
  return patch;
}

PolishFrame polishFrame(const PinholeCamera& camera,
                        const SE3& T_cam_ref,
                        const BrightnessTransfer& transfer,
                        const PyramidLevel& image) {
  PolishFrame frame{};
  const Eigen::Matrix3d R = T_cam_ref.rotationMatrix();
  for (int row = 0; row < 3; ++row) {
    frame.by_x[static_cast<std::size_t>(row)] = static_cast<float>(R(row, 0) / camera.fx);
    frame.by_y[static_cast<std::size_t>(row)] = static_cast<float>(R(row, 1) / camera.fy);
  }
  frame.image = image.data();
  frame.width = image.width();
  frame.height = image.height();
  frame.fx = static_cast<float>(camera.fx);
  frame.fy = static_cast<float>(camera.fy);
  frame.cx = static_cast<float>(camera.cx);
  frame.cy = static_cast<float>(camera.cy);
  frame.gain = static_cast<float>(transfer.gain);
  frame.offset = static_cast<float>(transfer.offset);
  return frame;
}

bool linearizePolish(const PolishFrame& frame,
                     const PolishPatch& patch,
                     const std::array<float, 3>& direction,
                     PolishSums& sums) {
  Lanes totals;
  if (!patch.valid || !linearizeInLanes(frame, patch, direction.data(), totals)) return false;
  sums = {totals[0], totals[1], totals[2], totals[3], totals[4], totals[5], totals[6], totals[7]};
  return std::isfinite(sums.magnitude);
}

}  // namespace dsorb::init_orb
