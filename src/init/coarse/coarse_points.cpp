// SPDX-License-Identifier: BSD-3-Clause
#include "init/coarse/coarse_points.h"

#include "base/median.h"
#include "estimate/host_patch.h"
#include "image/photometric.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace dsorb::init_coarse {
namespace {

constexpr std::array<double, 5> kDensities = {0.03, 0.05, 0.15, 0.5, 1.0};  // of level 0's pixels
constexpr int kMinGoodNeighbours = 3;
constexpr double kPointsPerCell = 3;

struct Neighbour {
  float squared_distance;
  std::int32_t index;
};
using NeighbourList = std::array<Neighbour, kNeighbours>;

/// Points in square cells, for nearest-neighbour searches.
class PointGrid {
 public:
  explicit PointGrid(const PointLevel& level) : level_(level) {
    const auto [min_x, max_x] = std::minmax_element(level.x.begin(), level.x.end());
    const auto [min_y, max_y] = std::minmax_element(level.y.begin(), level.y.end());
    left_ = *min_x;
    top_ = *min_y;
    const double area = (*max_x - *min_x + 1.0) * (*max_y - *min_y + 1.0);
    cell_ = static_cast<float>(std::sqrt(area * kPointsPerCell / level.size()));
    columns_ = static_cast<int>((*max_x - *min_x) / cell_) + 1;
    rows_ = static_cast<int>((*max_y - *min_y) / cell_) + 1;
    start_.assign(static_cast<std::size_t>(columns_) * static_cast<std::size_t>(rows_) + 1, 0);
    for (int i = 0; i < level.size(); ++i) ++start_[cellOf(i) + 1];
    for (std::size_t c = 1; c < start_.size(); ++c) start_[c] += start_[c - 1];
    members_.resize(static_cast<std::size_t>(level.size()));
    std::vector<std::int32_t> next(start_.begin(), start_.end() - 1);
    for (int i = 0; i < level.size(); ++i) {
      members_[static_cast<std::size_t>(next[cellOf(i)]++)] = i;
    }
  }

  /// @return number found, at most `wanted`; sorted by distance, then index
  int nearest(float x, float y, int wanted, NeighbourList& found) const {
    const int column =
        std::clamp(static_cast<int>(std::floor((x - left_) / cell_)), 0, columns_ - 1);
    const int row = std::clamp(static_cast<int>(std::floor((y - top_) / cell_)), 0, rows_ - 1);
    int count = 0;
    for (int ring = 0; ring <= std::max(columns_, rows_); ++ring) {
      const float reach = static_cast<float>(ring - 1) * cell_;  // whatever is nearer has been seen
      if (count == wanted && ring > 0 &&
          found[static_cast<std::size_t>(count - 1)].squared_distance < reach * reach) {
        break;
      }
      for (int r = std::max(0, row - ring); r <= std::min(rows_ - 1, row + ring); ++r) {
        const bool whole_row = r == row - ring || r == row + ring;
        const int step = whole_row || ring == 0 ? 1 : 2 * ring;
        for (int c = column - ring; c <= column + ring; c += step) {
          if (c >= 0 && c < columns_) searchCell(r, c, {x, y, wanted}, found, count);
        }
      }
    }
    return count;
  }

 private:
  struct Query {
    float x;
    float y;
    int wanted;
  };

  [[nodiscard]] std::size_t cellOf(int i) const {
    const auto index = static_cast<std::size_t>(i);
    const int column = static_cast<int>((level_.x[index] - left_) / cell_);
    const int row = static_cast<int>((level_.y[index] - top_) / cell_);
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) +
           static_cast<std::size_t>(column);
  }

  void searchCell(int row, int column, const Query& query, NeighbourList& found, int& count) const {
    const std::size_t cell = static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) +
                             static_cast<std::size_t>(column);
    for (std::int32_t m = start_[cell]; m < start_[cell + 1]; ++m) {
      const std::int32_t index = members_[static_cast<std::size_t>(m)];
      const float dx = level_.x[static_cast<std::size_t>(index)] - query.x;
      const float dy = level_.y[static_cast<std::size_t>(index)] - query.y;
      insert({dx * dx + dy * dy, index}, query.wanted, found, count);
    }
  }

  static void insert(const Neighbour& candidate, int wanted, NeighbourList& found, int& count) {
    const auto before = [](const Neighbour& a, const Neighbour& b) {
      return a.squared_distance < b.squared_distance ||
             (a.squared_distance == b.squared_distance && a.index < b.index);
    };
    if (count == wanted && !before(candidate, found[static_cast<std::size_t>(count - 1)])) return;
    if (count < wanted) ++count;
    auto slot = static_cast<std::size_t>(count - 1);
    for (; slot > 0 && before(candidate, found[slot - 1]); --slot) found[slot] = found[slot - 1];
    found[slot] = candidate;
  }

  const PointLevel& level_;
  float left_ = 0;
  float top_ = 0;
  float cell_ = 1;
  int columns_ = 1;
  int rows_ = 1;
  std::vector<std::int32_t> start_;
  std::vector<std::int32_t> members_;
};

void findNeighbours(PointLevel& level) {
  const PointGrid grid(level);
  NeighbourList found;
  level.neighbours.assign(level.x.size() * kNeighbours, -1);
  for (std::size_t i = 0; i < level.x.size(); ++i) {
    const int count = grid.nearest(level.x[i], level.y[i], kNeighbours, found);
    for (int n = 0; n < count; ++n) {
      level.neighbours[i * kNeighbours + static_cast<std::size_t>(n)] =
          found[static_cast<std::size_t>(n)].index;
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
  return static_cast<int>(std::lround(kDensities[index] * width * height));
}

PointLevel makePointLevel(const PyramidLevel& image, const std::vector<SelectedPixel>& pixels) {
  PointLevel level;
  for (const SelectedPixel& pixel : pixels) {
    const float x = static_cast<float>(pixel.x) + kPixelOffset;
    const float y = static_cast<float>(pixel.y) + kPixelOffset;
    const std::optional<HostPattern> patch = readHostPattern(image, {x, y});
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
  const PointGrid grid(coarse);
  const double limit = max_distance > 0 ? max_distance * max_distance : HUGE_VAL;
  NeighbourList found;
  for (std::size_t i = 0; i < fine.x.size(); ++i) {
    const int count = grid.nearest(0.5F * fine.x[i] - 0.25F,
                                   0.5F * fine.y[i] - 0.25F,
                                   1,
                                   found);  // pixel centres of 2 x 2 means
    fine.parent[i] = count > 0 && found[0].squared_distance <= limit ? found[0].index : -1;
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
