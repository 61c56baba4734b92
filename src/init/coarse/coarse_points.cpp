// SPDX-License-Identifier: BSD-3-Clause
#include "init/coarse/coarse_points.h"

#include "base/median.h"
#include "estimate/host_patch.h"
#include "image/cell_grid.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

namespace dsorb::init_coarse {
namespace {

constexpr std::array<double, 5> kDensities = {0.03, 0.05, 0.15, 0.5, 1.0};  // of level 0's pixels
constexpr int kMinGoodNeighbours = 3;
constexpr double kPointsPerCell = 3;

PointGrid gridOf(const PointLevel& level) {
  std::vector<Eigen::Vector2f> points;
  for (std::size_t i = 0; i < level.x.size(); ++i) points.emplace_back(level.x[i], level.y[i]);
  const float width = *std::max_element(level.x.begin(), level.x.end()) + 1;
  const float height = *std::max_element(level.y.begin(), level.y.end()) + 1;
  const double cell = std::sqrt(width * height * kPointsPerCell / level.size());
  return {std::move(points), CellGrid(static_cast<int>(width), static_cast<int>(height), cell)};
}

void findNeighbours(PointLevel& level) {
  const PointGrid grid = gridOf(level);
  level.neighbours.assign(level.x.size() * kNeighbours, -1);
  for (std::size_t i = 0; i < level.x.size(); ++i) {
    std::int32_t* next = &level.neighbours[i * kNeighbours];
    for (const auto& found : grid.nearest<kNeighbours>({level.x[i], level.y[i]}, HUGE_VALF)) {
      *next++ = static_cast<std::int32_t>(found.point);
    }
  }
}

/// Element count / 2 of all neighbours' sorted values: keeps the least in order, without branches.
float upperMedianOfAll(const float* values) {
  std::array<float, kNeighbours / 2 + 1> least{};
  least.fill(HUGE_VALF);
  for (int i = 0; i < kNeighbours; ++i) {
    float value = values[i];
    for (float& slot : least) {
      const float low = std::min(slot, value);
      value = std::max(slot, value);
      slot = low;
    }
  }
  return least.back();
}

/// Element count / 2 of the sorted values, count at least 1; reorders them.
float upperMedian(float* values, int count) {
  for (int i = 1; i < count; ++i) {
    const float value = values[i];
    int slot = i;
    for (; slot > 0 && values[slot - 1] > value; --slot) values[slot] = values[slot - 1];
    values[slot] = value;
  }
  return values[count / 2];
}

}  // namespace

int wantedPoints(int level, int width, int height) {
  const std::size_t index = std::min(static_cast<std::size_t>(level), kDensities.size() - 1);
  return std::max(1, static_cast<int>(std::lround(kDensities[index] * width * height)));
}

PointLevel makePointLevel(const PyramidLevel& image, const std::vector<SelectedPixel>& pixels) {
  PointLevel level;
  for (const SelectedPixel& pixel : pixels) {
    const float x = static_cast<float>(pixel.x) + kPixelOffset;
    const float y = static_cast<float>(pixel.y) + kPixelOffset;
    const auto patch = readHostPatch<interpolate<float>>(image, {x, y});
    if (!patch) continue;
    level.x.push_back(x);
    level.y.push_back(y);
    level.reference.insert(level.reference.end(), patch->grey.begin(), patch->grey.end());
  }
  const std::size_t n = level.x.size();
  level.parent.assign(n, -1);
  for (auto* depths : {&level.inverse_depth, &level.trial_inverse_depth, &level.smoothed}) {
    depths->assign(n, 1.0F);
  }
  for (auto* zeros : {&level.energy,
                      &level.trial_energy,
                      &level.curvature,
                      &level.trial_curvature,
                      &level.max_step}) {
    zeros->assign(n, 0.0F);
  }
  level.good.assign(n, 1);
  level.trial_good.assign(n, 1);
  if (n > 0) findNeighbours(level);
  return level;
}

void findParents(const PointLevel& coarse, double max_distance, PointLevel& fine) {
  if (coarse.size() == 0) return;
  const PointGrid grid = gridOf(coarse);
  const float limit = max_distance > 0 ? static_cast<float>(max_distance) : HUGE_VALF;
  for (std::size_t i = 0; i < fine.x.size(); ++i) {
    // Pixel centres of 2 x 2 means.
    const auto found = grid.nearest<1>({0.5F * fine.x[i] - 0.25F, 0.5F * fine.y[i] - 0.25F}, limit);
    fine.parent[i] = found.count > 0 ? static_cast<std::int32_t>(found.nearest[0].point) : -1;
  }
}

void flatten(PointLevel& level) {
  for (auto* depths : {&level.inverse_depth, &level.trial_inverse_depth, &level.smoothed}) {
    std::fill(depths->begin(), depths->end(), 1.0F);
  }
  std::fill(level.curvature.begin(), level.curvature.end(), 0.0F);
}

void smooth(PointLevel& level) {
  std::array<float, kNeighbours> values{};
  for (std::size_t i = 0; i < level.x.size(); ++i) {
    if (level.good[i] == 0) continue;
    int count = 0;
    for (std::size_t n = 0; n < kNeighbours; ++n) {
      const std::int32_t other = level.neighbours[i * kNeighbours + n];
      if (other < 0) break;
      if (level.good[static_cast<std::size_t>(other)] == 0) continue;
      values[static_cast<std::size_t>(count++)] = level.smoothed[static_cast<std::size_t>(other)];
    }
    if (count < kMinGoodNeighbours) continue;
    const float median =
        count == kNeighbours ? upperMedianOfAll(values.data()) : upperMedian(values.data(), count);
    level.smoothed[i] =
        (1.0F - kSmoothingWeight) * level.inverse_depth[i] + kSmoothingWeight * median;
  }
}

float neighbourSpread(const PointLevel& level, std::size_t point) {
  std::array<float, kNeighbours> off{};
  int count = 0;
  for (std::size_t n = 0; n < kNeighbours; ++n) {
    const std::int32_t other = level.neighbours[point * kNeighbours + n];
    if (other < 0) break;
    const auto neighbour = static_cast<std::size_t>(other);
    if (level.good[neighbour] == 0) continue;
    off[static_cast<std::size_t>(count++)] =
        std::abs(level.inverse_depth[neighbour] - level.smoothed[point]);
  }
  if (count < kMinGoodNeighbours) return 0;
  return static_cast<float>(kMadToSigma) * upperMedian(off.data(), count);
}

void propagateDown(const PointLevel& coarse, PointLevel& fine) {
  for (std::size_t i = 0; i < fine.x.size(); ++i) {
    if (fine.parent[i] < 0) continue;
    const auto parent = static_cast<std::size_t>(fine.parent[i]);
    const float weight = coarse.curvature[parent];
    if (coarse.good[parent] == 0 || weight < kMinParentCurvature) continue;
    float depth = coarse.smoothed[parent];
    if (fine.good[i] == 0) {
      fine.good[i] = 1;
      fine.curvature[i] = 0;
    } else {
      const float own = 2.0F * fine.curvature[i];
      depth = (own * fine.smoothed[i] + weight * depth) / (own + weight);
    }
    fine.smoothed[i] = fine.inverse_depth[i] = fine.trial_inverse_depth[i] = depth;
  }
}

void propagateUp(const PointLevel& fine, bool keep_orphans, PointLevel& coarse) {
  std::vector<float> sums(coarse.x.size(), 0.0F);
  std::vector<float> weights(coarse.x.size(), 0.0F);
  for (std::size_t i = 0; i < fine.x.size(); ++i) {
    if (fine.good[i] == 0 || fine.parent[i] < 0) continue;
    const auto parent = static_cast<std::size_t>(fine.parent[i]);
    sums[parent] += fine.curvature[i] * fine.smoothed[i];
    weights[parent] += fine.curvature[i];
  }
  for (std::size_t p = 0; p < coarse.x.size(); ++p) {
    if (weights[p] > 0) {
      coarse.smoothed[p] = coarse.inverse_depth[p] = sums[p] / weights[p];
      coarse.good[p] = 1;
    } else if (!keep_orphans) {
      coarse.smoothed[p] = 0;
    }
  }
}

void reviveFromNeighbours(PointLevel& level) {
  for (std::size_t i = 0; i < level.x.size(); ++i) {
    if (level.good[i] != 0) continue;
    float sum = 0;
    int count = 0;
    for (std::size_t n = 0; n < kNeighbours; ++n) {
      const std::int32_t other = level.neighbours[i * kNeighbours + n];
      if (other < 0) break;
      if (level.good[static_cast<std::size_t>(other)] == 0) continue;
      sum += level.smoothed[static_cast<std::size_t>(other)];
      ++count;
    }
    if (count == 0) continue;
    level.good[i] = 1;
    level.smoothed[i] = level.inverse_depth[i] = level.trial_inverse_depth[i] =
        sum / static_cast<float>(count);
  }
}

}  // namespace dsorb::init_coarse
