// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"

#include <Eigen/Core>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <utility>
#include <vector>

namespace dsorb {

/// Cells over an image, row by row.
class CellGrid {
 public:
  /// Square cells. @param side of a cell [px]
  CellGrid(int width, int height, double side)
      : width_(side),
        height_(side),
        columns_(std::max(1, static_cast<int>(std::ceil(width / side)))),
        rows_(std::max(1, static_cast<int>(std::ceil(height / side)))) {}
  CellGrid(int width, int height, int columns, int rows)
      : width_(static_cast<double>(width) / columns),
        height_(static_cast<double>(height) / rows),
        columns_(columns),
        rows_(rows) {}

  /// Width of a cell [px].
  [[nodiscard]] double cell() const { return width_; }
  [[nodiscard]] int columns() const { return columns_; }
  [[nodiscard]] int rows() const { return rows_; }
  [[nodiscard]] std::size_t size() const { return index(0, rows_); }
  [[nodiscard]] std::size_t index(int column, int row) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(columns_) +
           static_cast<std::size_t>(column);
  }
  /// Column and row of the cell at a position; positions outside belong to the border's cells.
  [[nodiscard]] int column(double x) const {
    return std::clamp(static_cast<int>(x / width_), 0, columns_ - 1);
  }
  [[nodiscard]] int row(double y) const {
    return std::clamp(static_cast<int>(y / height_), 0, rows_ - 1);
  }
  /// Index of the cell at a position.
  [[nodiscard]] std::size_t at(double x, double y) const { return index(column(x), row(y)); }

 private:
  double width_;   // of a cell [px]
  double height_;  // of a cell [px]
  int columns_;
  int rows_;
};

/// Cells of an image whose errors count as one.
constexpr int kErrorColumns = 10;
constexpr int kErrorRows = 8;
constexpr std::size_t kErrorCells = static_cast<std::size_t>(kErrorColumns) * kErrorRows;
inline CellGrid errorCells(int width, int height) {
  return {width, height, kErrorColumns, kErrorRows};
}

/// The one of errorCells() at a pixel of an image.
inline std::size_t imageCell(const Eigen::Vector2d& pixel, const PinholeCamera& camera) {
  return errorCells(camera.width, camera.height).at(pixel.x(), pixel.y());
}

/// The best thing of every cell: indices, ascending.
/// @param pixel_of position of a thing by its index [px]
/// @param better   whether the first of two is preferred, by their indices
template <typename PixelOf, typename Better>
std::vector<std::size_t> bestOfCells(const CellGrid& cells,
                                     const std::vector<std::size_t>& things,
                                     PixelOf&& pixel_of,
                                     Better&& better) {
  constexpr std::size_t kNone = SIZE_MAX;
  std::vector<std::size_t> best(cells.size(), kNone);
  for (const std::size_t i : things) {
    const Eigen::Vector2f pixel = pixel_of(i);
    std::size_t& holder = best[cells.at(pixel.x(), pixel.y())];
    if (holder == kNone || better(i, holder)) holder = i;
  }
  best.erase(std::remove(best.begin(), best.end(), kNone), best.end());
  std::sort(best.begin(), best.end());
  return best;
}

/// Side of the cells that corners and features are spread over [px].
constexpr int kSpreadCell = 64;

/// Spreads a number of things over the cells: each takes at most twice its even share, because
/// cells without texture leave theirs to others.
class CellQuota {
 public:
  CellQuota(const CellGrid& cells, int total) : cells_(cells), taken_(cells.size(), 0) {
    const auto count = static_cast<int>(cells.size());
    most_ = std::max(1, (2 * total + count - 1) / count);
  }
  /// Counts one more in the cell at a position. @return whether there was room for it
  bool take(double x, double y) { return taken_[cells_.at(x, y)]++ < most_; }

 private:
  CellGrid cells_;
  std::vector<int> taken_;  // by cell
  int most_;
};

/// Places of an image that keep a distance from each other.
class SpacedPlaces {
 public:
  /// @param distance that a new place keeps [px]
  SpacedPlaces(int width, int height, float distance)
      : cells_(width, height, std::max(distance, 1.0F)),
        squared_distance_(distance * distance),
        newest_(cells_.size(), kNone) {}

  /// A place that need not keep the distance.
  void add(const Eigen::Vector2f& place) {
    std::size_t& newest = newest_[cells_.at(place.x(), place.y())];
    places_.push_back({place, newest});
    newest = places_.size() - 1;
  }
  /// Adds a place unless it is too close to one. @return whether
  bool take(const Eigen::Vector2f& place) {
    const int column = cells_.column(place.x());
    const int row = cells_.row(place.y());
    for (int y = std::max(row - 1, 0); y <= std::min(row + 1, cells_.rows() - 1); ++y) {
      for (int x = std::max(column - 1, 0); x <= std::min(column + 1, cells_.columns() - 1); ++x) {
        for (std::size_t i = newest_[cells_.index(x, y)]; i != kNone; i = places_[i].before) {
          if ((places_[i].place - place).squaredNorm() < squared_distance_) return false;
        }
      }
    }
    add(place);
    return true;
  }

 private:
  static constexpr std::size_t kNone = SIZE_MAX;
  struct Placed {
    Eigen::Vector2f place;
    std::size_t before;  // of the same cell
  };

  CellGrid cells_;
  float squared_distance_;
  std::vector<std::size_t> newest_;  // by cell
  std::vector<Placed> places_;
};

/// Points of an image, to find those near a pixel.
class PointGrid {
 public:
  /// A point near a pixel.
  struct Neighbour {
    float squared_distance = 0;  ///< [px^2]
    std::size_t point = 0;       ///< index

    friend bool operator<(const Neighbour& a, const Neighbour& b) {
      return a.squared_distance < b.squared_distance ||
             (a.squared_distance == b.squared_distance && a.point < b.point);
    }
  };
  /// At most kWanted points, nearest first.
  template <std::size_t kWanted>
  struct Neighbours {
    std::array<Neighbour, kWanted> nearest;
    std::size_t count = 0;

    [[nodiscard]] const Neighbour* begin() const { return nearest.data(); }
    [[nodiscard]] const Neighbour* end() const { return nearest.data() + count; }
    /// Where several points are equally far, the one of the smallest index comes first.
    void add(const Neighbour& found) {
      if (count == kWanted && !(found < nearest[kWanted - 1])) return;
      std::size_t place = count < kWanted ? count++ : kWanted - 1;
      for (; place > 0 && found < nearest[place - 1]; --place) nearest[place] = nearest[place - 1];
      nearest[place] = found;
    }
  };

  PointGrid(std::vector<Eigen::Vector2f> points, const CellGrid& cells)
      : cells_(cells), points_(std::move(points)), first_(cells.size() + 1, 0) {
    for (const Eigen::Vector2f& point : points_) ++first_[cellOf(point) + 1];
    for (std::size_t i = 1; i < first_.size(); ++i) first_[i] += first_[i - 1];
    std::vector<std::size_t> next(first_.begin(), first_.end() - 1);
    sorted_.resize(points_.size());
    for (std::size_t i = 0; i < points_.size(); ++i) sorted_[next[cellOf(points_[i])]++] = i;
  }

  [[nodiscard]] std::size_t size() const { return points_.size(); }

  /// Calls visit(index) for all points closer to a pixel than a radius.
  template <typename Visit>
  void forEachWithin(const Eigen::Vector2f& pixel, float radius, Visit&& visit) const {
    for (int y = cells_.row(pixel.y() - radius); y <= cells_.row(pixel.y() + radius); ++y) {
      for (int x = cells_.column(pixel.x() - radius); x <= cells_.column(pixel.x() + radius); ++x) {
        const std::size_t cell = cells_.index(x, y);
        for (std::size_t i = first_[cell]; i < first_[cell + 1]; ++i) {
          const float squared = (points_[sorted_[i]] - pixel).squaredNorm();
          if (squared < radius * radius) visit(sorted_[i]);
        }
      }
    }
  }

  /// The nearest points within a radius, found ring by ring of cells.
  /// @param accept whether a point counts, by its index
  template <std::size_t kWanted, typename Accept>
  [[nodiscard]] Neighbours<kWanted> nearest(const Eigen::Vector2f& pixel,
                                            float radius,
                                            Accept&& accept) const {
    Neighbours<kWanted> found;
    const auto visit = [&](int column, int row) {
      if (column < 0 || row < 0 || column >= cells_.columns() || row >= cells_.rows()) return;
      const std::size_t cell = cells_.index(column, row);
      for (std::size_t i = first_[cell]; i < first_[cell + 1]; ++i) {
        const float squared = (points_[sorted_[i]] - pixel).squaredNorm();
        if (squared <= radius * radius && accept(sorted_[i])) found.add({squared, sorted_[i]});
      }
    };
    const int x = cells_.column(pixel.x());
    const int y = cells_.row(pixel.y());
    const auto cell_size = static_cast<float>(cells_.cell());
    const auto all = static_cast<float>(std::max(cells_.columns(), cells_.rows()));
    const int rings = static_cast<int>(std::min(radius / cell_size + 1, all));
    for (int ring = 0; ring <= rings; ++ring) {
      // Every point of this ring is at least so far away.
      const float closest = static_cast<float>(ring - 1) * cell_size;
      if (found.count == kWanted && ring > 1 &&
          found.nearest.back().squared_distance < closest * closest) {
        break;
      }
      for (int dy = -ring; dy <= ring; ++dy) {
        const int step = std::abs(dy) == ring ? 1 : 2 * ring;
        for (int dx = -ring; dx <= ring; dx += std::max(step, 1)) visit(x + dx, y + dy);
      }
    }
    return found;
  }

  /// All points count.
  template <std::size_t kWanted>
  [[nodiscard]] Neighbours<kWanted> nearest(const Eigen::Vector2f& pixel, float radius) const {
    return nearest<kWanted>(pixel, radius, [](std::size_t) { return true; });
  }

 private:
  [[nodiscard]] std::size_t cellOf(const Eigen::Vector2f& point) const {
    return cells_.at(point.x(), point.y());
  }

  CellGrid cells_;
  std::vector<Eigen::Vector2f> points_;
  std::vector<std::size_t> sorted_;  // points by cell
  std::vector<std::size_t> first_;   // by cell, one more at the end
};

}  // namespace dsorb
