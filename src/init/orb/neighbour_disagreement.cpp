// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/neighbour_disagreement.h"

#include "base/parallel.h"
#include "image/cell_grid.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace dsorb::init_orb {
namespace {

constexpr std::size_t kNeighbours = 7;
constexpr std::size_t kMinNeighbours = 3;
constexpr float kCellSize = 1.0F / 3;      // of the radius
constexpr float kQuantile = 0.35F;         // of the differences
constexpr std::size_t kPointsAtOnce = 64;  // points one thread takes at a time

PointGrid gridOf(const std::vector<Eigen::Vector2f>& pixels, float cell_size) {
  Eigen::Vector2f farthest(0, 0);
  for (const Eigen::Vector2f& pixel : pixels) farthest = farthest.cwiseMax(pixel);
  return {
      pixels,
      CellGrid(static_cast<int>(farthest.x()) + 1, static_cast<int>(farthest.y()) + 1, cell_size)};
}

}  // namespace

std::vector<double> neighbourDisagreement(const std::vector<Eigen::Vector2f>& pixels,
                                          const std::vector<double>& inverse_depths,
                                          float radius) {
  const PointGrid grid = gridOf(pixels, kCellSize * radius);
  std::vector<double> logs(inverse_depths.size());
  std::transform(inverse_depths.begin(), inverse_depths.end(), logs.begin(), [](double rho) {
    return rho > 0 ? std::log(rho) : -std::numeric_limits<double>::infinity();
  });
  std::vector<double> disagreement(pixels.size(), 0.0);
  forEachRange(pixels.size(), kPointsAtOnce, [&](std::size_t begin, std::size_t end) {
    for (std::size_t i = begin; i < end; ++i) {
      const auto neighbours = grid.nearest<kNeighbours>(pixels[i], radius, [&](std::size_t other) {
        return other != i && inverse_depths[other] > 0;
      });
      if (neighbours.count < kMinNeighbours) continue;
      std::array<double, kNeighbours> differences;
      differences.fill(std::numeric_limits<double>::infinity());
      std::transform(
          neighbours.begin(), neighbours.end(), differences.begin(), [&](const auto& neighbour) {
            return std::abs(logs[neighbour.point] - logs[i]);
          });
      std::sort(differences.begin(), differences.end());
      disagreement[i] =
          differences[static_cast<std::size_t>(kQuantile * static_cast<float>(neighbours.count))];
    }
  });
  return disagreement;
}

}  // namespace dsorb::init_orb
