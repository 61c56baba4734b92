// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/semi_dense/corner_prior.h"

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace dsorb::init_orb {
namespace {

constexpr float kRadius = 60;      // corners farther away do not count [px]
constexpr int kCellSize = 32;      // [px]
constexpr int kMinNeighbours = 3;  // for a spread that means something
constexpr float kWiden = 2;        // of the range of all corners

int cellOf(float coordinate, int cells) {
  return std::clamp(static_cast<int>(coordinate) / kCellSize, 0, cells - 1);
}

}  // namespace

CornerPrior::CornerPrior(const std::vector<Corner>& corners, int width, int height)
    : cells_x_((width + kCellSize - 1) / kCellSize),
      cells_y_((height + kCellSize - 1) / kCellSize),
      first_entry_(static_cast<std::size_t>(cells_x_) * static_cast<std::size_t>(cells_y_) + 1, 0) {
  const auto cell = [&](const Eigen::Vector2f& pixel) {
    const std::ptrdiff_t row = cellOf(pixel.y(), cells_y_);
    return static_cast<std::size_t>(row * cells_x_ + cellOf(pixel.x(), cells_x_));
  };
  auto low = static_cast<float>(corners.front().inverse_depth);
  float high = low;
  for (const Corner& corner : corners) {
    entries_.push_back({corner.pixel.cast<float>(),
                        static_cast<float>(corner.inverse_depth),
                        static_cast<float>(corner.variance)});
    ++first_entry_[cell(entries_.back().pixel) + 1];
    low = std::min(low, entries_.back().inverse_depth);
    high = std::max(high, entries_.back().inverse_depth);
  }
  for (std::size_t i = 1; i < first_entry_.size(); ++i) {
    first_entry_[i] += first_entry_[i - 1];
  }
  std::stable_sort(entries_.begin(), entries_.end(), [&](const Entry& a, const Entry& b) {
    return cell(a.pixel) < cell(b.pixel);
  });
  low /= kWiden;
  high *= kWiden;
  const float sigma = 0.5F * (high - low) / kSearchSigmas;
  wide_ = {0.5F * (low + high), sigma * sigma};
}

void CornerPrior::collectCell(int cell_x,
                              int cell_y,
                              const Eigen::Vector2f& pixel,
                              Neighbours& out) const {
  if (cell_x < 0 || cell_y < 0 || cell_x >= cells_x_ || cell_y >= cells_y_) {
    return;
  }
  const auto cell = static_cast<std::size_t>(std::ptrdiff_t{cell_y} * cells_x_ + cell_x);
  for (int i = first_entry_[cell]; i < first_entry_[cell + 1]; ++i) {
    const Entry& entry = entries_[static_cast<std::size_t>(i)];
    const float squared = (entry.pixel - pixel).squaredNorm();
    if (squared > kRadius * kRadius ||
        (out.count == kNeighbours && squared >= out.squared_distance[out.count - 1])) {
      continue;
    }
    int place = out.count < kNeighbours ? out.count++ : out.count - 1;
    for (; place > 0 && out.squared_distance[place - 1] > squared; --place) {
      out.squared_distance[place] = out.squared_distance[place - 1];
      out.entry[place] = out.entry[place - 1];
    }
    out.squared_distance[place] = squared;
    out.entry[place] = &entry;
  }
}

CornerPrior::Neighbours CornerPrior::nearest(const Eigen::Vector2f& pixel) const {
  Neighbours out;
  const int x = cellOf(pixel.x(), cells_x_);
  const int y = cellOf(pixel.y(), cells_y_);
  const int rings = static_cast<int>(kRadius) / kCellSize + 1;
  for (int ring = 0; ring <= rings; ++ring) {
    // Every corner of this ring is at least so far away.
    const auto closest = static_cast<float>((ring - 1) * kCellSize);
    if (out.count == kNeighbours && ring > 1 &&
        out.squared_distance[out.count - 1] < closest * closest) {
      break;
    }
    for (int dy = -ring; dy <= ring; ++dy) {
      const int step = std::abs(dy) == ring ? 1 : 2 * ring;
      for (int dx = -ring; dx <= ring; dx += std::max(step, 1)) {
        collectCell(x + dx, y + dy, pixel, out);
      }
    }
  }
  return out;
}

DepthEstimate CornerPrior::at(const Eigen::Vector2f& pixel) const {
  const Neighbours neighbours = nearest(pixel);
  if (neighbours.count < kMinNeighbours) {
    return wide_;
  }
  float sum = 0;
  float mean = 0;
  for (int i = 0; i < neighbours.count; ++i) {
    const float weight = 1.0F / (1.0F + std::sqrt(neighbours.squared_distance[i]));
    sum += weight;
    mean += weight * neighbours.entry[i]->inverse_depth;
  }
  mean /= sum;
  float variance = 0;
  for (int i = 0; i < neighbours.count; ++i) {
    const float weight = 1.0F / (1.0F + std::sqrt(neighbours.squared_distance[i]));
    const float difference = neighbours.entry[i]->inverse_depth - mean;
    variance += weight * (difference * difference + neighbours.entry[i]->variance);
  }
  const float floor = kMinPriorSigma * mean;
  return {mean, std::max(variance / sum, floor * floor)};
}

}  // namespace dsorb::init_orb
