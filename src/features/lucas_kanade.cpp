// SPDX-License-Identifier: BSD-3-Clause
#include "features/lucas_kanade.h"

#include "base/lanes.h"
#include "base/parallel.h"
#include "base/target_clones.h"

#include <algorithm>
#include <cmath>

namespace dsorb {
namespace {

constexpr float kMaxIntensity = 255;      // [grey levels]
constexpr std::ptrdiff_t kPart = kLanes;  // of a template's step: intensity, dx, dy
constexpr std::ptrdiff_t kTemplateStep = 3 * kPart;

constexpr std::ptrdiff_t kPatchStride = kFlowColumns + kLanes;
constexpr int kMaxIterations = 30;  // on each level
constexpr float kMinStep = 0.01F;   // a smaller one ends the iteration [px of the level]

/// Pixels around a level, so that a window whose first pixel is between -kFlowWindow and the size
/// can be read with its gradients.
constexpr int kBorder = kFlowColumns + kLanes + 2;

void resize(FlowLevel& level, int width, int height) {
  level.width = width;
  level.height = height;
  level.stride = width + 2 * kBorder;
  level.memory.resize(static_cast<std::size_t>(level.stride) *
                      static_cast<std::size_t>(height + 2 * kBorder));
  level.origin = kBorder * level.stride + kBorder;
}

/// Pixel that stands for one outside: the image continues mirrored, the outermost pixel not
/// doubled.
int mirrored(int index, int size) {
  const int period = std::max(1, 2 * (size - 1));
  const int folded = (index % period + period) % period;
  return std::min(folded, period - folded);
}

void extendRow(FlowLevel& level, int y) {
  float* row = level.row(y);
  for (int k = 1; k <= kBorder; ++k) {
    row[-k] = row[mirrored(-k, level.width)];
    row[level.width - 1 + k] = row[mirrored(level.width - 1 + k, level.width)];
  }
}

void extendColumns(FlowLevel& level) {
  for (int k = 1; k <= kBorder; ++k) {
    for (const int y : {-k, level.height - 1 + k}) {
      const float* source = level.row(mirrored(y, level.height)) - kBorder;
      std::copy(source, source + level.stride, level.row(y) - kBorder);
    }
  }
}

/// @return whether all are valid
DSORB_TARGET_CLONES bool copyRow(const float* source, int width, float gain, float* row) {
  int valid = 1;
  for (int x = 0; x < width; ++x) {
    const float value = gain * source[x];
    valid &= value == value ? 1 : 0;
    const float positive = value > 0 ? value : 0;  // and no NaN
    row[x] = positive < kMaxIntensity ? positive : kMaxIntensity;
  }
  return valid != 0;
}

/// A row of the next level, binomial weights 1 4 6 4 1 both ways. @param smoothed fine row's length
DSORB_TARGET_CLONES void halveRow(
    const FlowLevel& fine, int y, float* smoothed, float* row, int width) {
  const float* r0 = fine.row(y - 2) - kLanes;
  const float* r1 = r0 + fine.stride;
  const float* r2 = r1 + fine.stride;
  const float* r3 = r2 + fine.stride;
  const float* r4 = r3 + fine.stride;
  for (int x = 0; x < fine.width + 2 * kLanes; ++x) {
    smoothed[x] = (r0[x] + r4[x] + 4 * (r1[x] + r3[x]) + 6 * r2[x]) * (1.0F / 256);
  }
  const float* s = smoothed + kLanes;
  for (std::ptrdiff_t x = 0; x < width; ++x) {
    row[x] = s[2 * x - 2] + s[2 * x + 2] + 4 * (s[2 * x - 1] + s[2 * x + 1]) + 6 * s[2 * x];
  }
}

/// Where a window begins between the pixels of a level.
struct WindowCorner {
  int x, y;
  float fx, fy;
};

DSORB_ALWAYS_INLINE bool cornerAt(const FlowLevel& level, float x, float y, WindowCorner& corner) {
  constexpr float kHalf = 0.5F * (kFlowWindow - 1);
  const float left = std::floor(x - kHalf);
  const float top = std::floor(y - kHalf);
  // Written so that NaN is outside.
  if (!(left >= -kFlowWindow && top >= -kFlowWindow && left < static_cast<float>(level.width) &&
        top < static_cast<float>(level.height))) {
    return false;
  }
  corner = {static_cast<int>(left), static_cast<int>(top), x - kHalf - left, y - kHalf - top};
  return true;
}

/// Eight pixels that lie beside each other and share one fraction, for a row that the lines above
/// and below it share as well: the samplers of src/estimate take a position for every pixel.
DSORB_ALWAYS_INLINE Lanes interpolateRow(const float* row, float fx) {
  const Lanes left = load(row);
  return left + fx * (load(row + 1) - left);
}

/// Gradient tensor of the window, summed.
struct Tensor {
  float xx, xy, yy;
};

/// Interpolates the window with one more pixel on every side.
DSORB_ALWAYS_INLINE void cutPatch(const FlowLevel& level, const WindowCorner& at, float* patch) {
  for (int column = 0; column < kPatchStride; column += kLanes) {
    const float* source = level.row(at.y - 1) + at.x - 1 + column;
    float* target = patch + column;
    Lanes upper = interpolateRow(source, at.fx);
    for (int row = 0; row < kFlowWindow + 2; ++row) {
      source += level.stride;
      const Lanes lower = interpolateRow(source, at.fx);
      store(upper + at.fy * (lower - upper), target);
      target += kPatchStride;
      upper = lower;
    }
  }
}

/// Scharr's weights across the derivative, 3 10 3, of the pixels at p, p + step, p + 2 step.
DSORB_ALWAYS_INLINE Lanes smooth(const float* p, std::ptrdiff_t step) {
  return (3.0F / 32) * (load(p) + load(p + 2 * step)) + (10.0F / 32) * load(p + step);
}

/// Columns and rows of a window that lie inside the image.
struct Inside {
  int left, right, top, bottom;

  Inside(const FlowLevel& level, const WindowCorner& at)
      : left(std::max(0, -at.x)),
        right(std::min(kFlowWindow, level.width - 1 - at.x)),
        top(std::max(0, -at.y)),
        bottom(std::min(kFlowWindow, level.height - 1 - at.y)) {}
};

/// Intensities and gradients of a patch; no gradients beyond the window and outside the image.
DSORB_ALWAYS_INLINE void makeTemplate(const float* patch,
                                      const Inside& inside,
                                      float* target,
                                      Tensor& tensor) {
  Lanes xx = {};
  Lanes xy = {};
  Lanes yy = {};
  for (int column = 0; column < kFlowWindow; column += kLanes) {
    Lanes used;
    for (int k = 0; k < kLanes; ++k) {
      used[k] = column + k >= inside.left && column + k < inside.right ? 1.0F : 0.0F;
    }
    const float* p = patch + column;
    for (int row = 0; row < kFlowWindow; ++row, p += kPatchStride) {
      const float row_used = row >= inside.top && row < inside.bottom ? 1.0F : 0.0F;
      const Lanes dx = row_used * used * (smooth(p + 2, kPatchStride) - smooth(p, kPatchStride));
      const Lanes dy = row_used * used * (smooth(p + 2 * kPatchStride, 1) - smooth(p, 1));
      store(load(p + kPatchStride + 1), target);
      store(dx, target + kPart);
      store(dy, target + 2 * kPart);
      target += kTemplateStep;
      xx += dx * dx;
      xy += dx * dy;
      yy += dy * dy;
    }
  }
  tensor = {sumLanes(xx), sumLanes(xy), sumLanes(yy)};
}

/// Sums of gradient times difference between a window and the template.
struct Slope {
  float x, y;
};

DSORB_ALWAYS_INLINE Slope compare(const FlowLevel& level,
                                  const WindowCorner& at,
                                  const float* source) {
  Lanes sum_x = {};
  Lanes sum_y = {};
  for (int column = 0; column < kFlowWindow; column += kLanes) {
    const float* pixels = level.row(at.y) + at.x + column;
    Lanes upper = interpolateRow(pixels, at.fx);
    for (int row = 0; row < kFlowWindow; ++row) {
      pixels += level.stride;
      const Lanes lower = interpolateRow(pixels, at.fx);
      const Lanes difference = upper + at.fy * (lower - upper) - load(source);
      sum_x += difference * load(source + kPart);
      sum_y += difference * load(source + 2 * kPart);
      source += kTemplateStep;
      upper = lower;
    }
  }
  return {sumLanes(sum_x), sumLanes(sum_y)};
}

/// What followOnLevel() works with.
struct LevelTask {
  const FlowLevel& from;
  const FlowLevel& to;
  float min_eigenvalue;
  float* patch;
  float* memory;
};

/// @param x, y the point in `from`; u, v a guess, then the result in `to`
/// @return     false without texture or outside
DSORB_TARGET_CLONES bool followOnLevel(
    const LevelTask& task, float x, float y, float& u, float& v) {
  WindowCorner at{};
  if (!cornerAt(task.from, x, y, at)) return false;
  Tensor tensor{};
  cutPatch(task.from, at, task.patch);
  makeTemplate(task.patch, Inside(task.from, at), task.memory, tensor);
  const float difference = tensor.xx - tensor.yy;
  const float root = std::sqrt(difference * difference + 4 * tensor.xy * tensor.xy);
  const float least = 0.5F * (tensor.xx + tensor.yy - root);
  const float determinant = tensor.xx * tensor.yy - tensor.xy * tensor.xy;
  constexpr float kPixels = kFlowWindow * kFlowWindow;
  if (!(least >= task.min_eigenvalue * kPixels && determinant > 0)) return false;
  float last_x = 0;
  float last_y = 0;
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    if (!cornerAt(task.to, u, v, at)) return false;
    const Slope b = compare(task.to, at, task.memory);
    const float step_x = (tensor.xy * b.y - tensor.yy * b.x) / determinant;
    const float step_y = (tensor.xy * b.x - tensor.xx * b.y) / determinant;
    u += step_x;
    v += step_y;
    if (step_x * step_x + step_y * step_y <= kMinStep * kMinStep) break;
    // Back and forth: the middle.
    if (iteration > 0 && std::abs(step_x + last_x) < kMinStep &&
        std::abs(step_y + last_y) < kMinStep) {
      u -= 0.5F * step_x;
      v -= 0.5F * step_y;
      break;
    }
    last_x = step_x;
    last_y = step_y;
  }
  return true;
}

}  // namespace

bool FlowPyramid::build(const PyramidLevel& image, float gain, const LucasKanadeOptions& options) {
  int count = 1;
  for (int width = image.width(), height = image.height(); count <= options.max_level; ++count) {
    width = (width + 1) / 2;
    height = (height + 1) / 2;
    if (width <= kFlowWindow || height <= kFlowWindow) break;
  }
  levels_.resize(static_cast<std::size_t>(count));
  FlowLevel& first = levels_.front();
  resize(first, image.width(), image.height());
  std::vector<char> valid(static_cast<std::size_t>(image.height()));
  forEachRange(valid.size(), kTaskGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const int y = static_cast<int>(i);
      valid[i] = copyRow(image.row(y), image.width(), gain, first.row(y)) ? 1 : 0;
      extendRow(first, y);
    }
  });
  extendColumns(first);
  for (std::size_t l = 1; l < levels_.size(); ++l) {
    const FlowLevel& fine = levels_[l - 1];
    FlowLevel& coarse = levels_[l];
    resize(coarse, (fine.width + 1) / 2, (fine.height + 1) / 2);
    forEachRange(static_cast<std::size_t>(coarse.height),
                 kTaskGrain,
                 [&](std::size_t begin, std::size_t end) {
                   std::vector<float> smoothed(static_cast<std::size_t>(fine.width + 2 * kLanes));
                   for (std::size_t i = begin; i < end; ++i) {
                     const int y = static_cast<int>(i);
                     halveRow(fine, 2 * y, smoothed.data(), coarse.row(y), coarse.width);
                     extendRow(coarse, y);
                   }
                 });
    extendColumns(coarse);
  }
  return std::find(valid.begin(), valid.end(), char{0}) == valid.end();
}

bool LucasKanade::follow(const FlowPyramid& from,
                         const FlowPyramid& to,
                         const Eigen::Vector2f& start,
                         Eigen::Vector2f& place) {
  const int levels = static_cast<int>(std::min(from.levels().size(), to.levels().size()));
  const float coarsest = 1.0F / static_cast<float>(1 << (levels - 1));
  Eigen::Vector2f guess = coarsest * place;
  for (int level = levels - 1; level >= 0; --level) {
    const auto l = static_cast<std::size_t>(level);
    const Eigen::Vector2f at = start / static_cast<float>(1 << level);
    const bool found = followOnLevel({from.levels()[l],
                                      to.levels()[l],
                                      static_cast<float>(options_.min_eigenvalue),
                                      patch_.data(),
                                      template_.data()},
                                     at.x(),
                                     at.y(),
                                     guess.x(),
                                     guess.y());
    if (level == 0 && !found) return false;
    if (level > 0) guess *= 2;
  }
  place = guess;
  return place.allFinite();
}

}  // namespace dsorb
