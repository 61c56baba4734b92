// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/photometric/neighbour_disagreement.h"

#include "base/parallel.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace dsorb::init_orb {
namespace {

constexpr int kNeighbours = 7;
constexpr int kMinNeighbours = 3;
constexpr float kRadius = 60;       // [px]
constexpr float kQuantile = 0.35F;  // of the differences
constexpr std::size_t kGrain = 64;  // points one thread takes at a time

/// Points by the cell of a grid they lie in.
class Grid {
 public:
  explicit Grid(const std::vector<Eigen::Vector2f>& pixels) {
    for (const Eigen::Vector2f& pixel : pixels) {
      columns_ = std::max(columns_, cell(pixel.x()) + 1);
      rows_ = std::max(rows_, cell(pixel.y()) + 1);
    }
    first_.assign(index(columns_, rows_ - 1) + 1, 0);
    for (const Eigen::Vector2f& pixel : pixels) ++first_[indexOf(pixel) + 1];
    for (std::size_t i = 1; i < first_.size(); ++i) first_[i] += first_[i - 1];
    std::vector<std::size_t> next(first_.begin(), first_.end() - 1);
    points_.resize(pixels.size());
    for (std::size_t i = 0; i < pixels.size(); ++i) points_[next[indexOf(pixels[i])]++] = i;
  }

  /// Calls function(point) for every point that may be within the radius.
  template <typename Function>
  void forEachNear(const Eigen::Vector2f& pixel, Function&& function) const {
    const int reach = static_cast<int>(std::ceil(kRadius / kCell));
    const int x = cell(pixel.x());
    const int y = cell(pixel.y());
    for (int row = std::max(0, y - reach); row <= std::min(rows_ - 1, y + reach); ++row) {
      const auto begin = index(std::max(0, x - reach), row);
      const auto end = index(std::min(columns_ - 1, x + reach), row);
      for (std::size_t i = first_[begin]; i < first_[end + 1]; ++i) function(points_[i]);
    }
  }

 private:
  static constexpr float kCell = 20;  // [px]
  static int cell(float coordinate) { return static_cast<int>(std::max(coordinate, 0.0F) / kCell); }
  [[nodiscard]] std::size_t index(int column, int row) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) +
           static_cast<std::size_t>(column);
  }
  [[nodiscard]] std::size_t indexOf(const Eigen::Vector2f& pixel) const {
    return index(cell(pixel.x()), cell(pixel.y()));
  }

  int columns_ = 1;
  int rows_ = 1;
  std::vector<std::size_t> first_;
  std::vector<std::size_t> points_;
};

struct Neighbour {
  float squared_distance = std::numeric_limits<float>::max();
  std::size_t point = 0;
};

}  // namespace

std::vector<double> neighbourDisagreement(const std::vector<Eigen::Vector2f>& pixels,
                                          const std::vector<double>& inverse_depths) {
  const Grid grid(pixels);
  std::vector<double> logs(inverse_depths.size());
  std::transform(inverse_depths.begin(), inverse_depths.end(), logs.begin(), [](double rho) {
    return rho > 0 ? std::log(rho) : -std::numeric_limits<double>::infinity();
  });
  std::vector<double> disagreement(pixels.size(), 0.0);
  forEachRange(pixels.size(), kGrain, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      std::array<Neighbour, kNeighbours> nearest;
      int count = 0;
      grid.forEachNear(pixels[i], [&](std::size_t other) {
        const float squared = (pixels[other] - pixels[i]).squaredNorm();
        if (other == i || squared > kRadius * kRadius ||
            squared >= nearest.back().squared_distance || !(inverse_depths[other] > 0)) {
          return;
        }
        std::size_t place = kNeighbours - 1;
        for (; place > 0 && nearest[place - 1].squared_distance > squared; --place) {
          nearest[place] = nearest[place - 1];
        }
        nearest[place] = {squared, other};
        count = std::min(count + 1, kNeighbours);
      });
      if (count < kMinNeighbours) continue;
      std::array<double, kNeighbours> differences{};
      for (int k = 0; k < count; ++k) {
        const auto at = static_cast<std::size_t>(k);
        differences[at] = std::abs(logs[nearest[at].point] - logs[i]);
      }
      std::sort(differences.begin(), differences.begin() + count);
      disagreement[i] =
          differences[static_cast<std::size_t>(kQuantile * static_cast<float>(count))];
    }
  });
  return disagreement;
}

}  // namespace dsorb::init_orb
