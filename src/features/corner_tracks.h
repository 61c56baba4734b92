// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "base/erase_marked.h"

#include <Eigen/Core>

#include <cstddef>
#include <vector>

namespace dsorb {

/// Fewest corners that tell a motion and that it is right.
constexpr int kMinCornersOfMotion = 50;

/// Pixels of the same corners in two images [px]; equal lengths.
struct Matches {
  std::vector<Eigen::Vector2d> reference;
  std::vector<Eigen::Vector2d> target;

  [[nodiscard]] std::size_t size() const { return reference.size(); }
};

/// Tracks of the corners of a reference: an attempt knows the motion of the images by them alone.
struct CornerTracks {
  /// [frame][corner], the reference first [px]; NaN where a corner was not seen. The reference and
  /// the newest frame see all.
  std::vector<std::vector<Eigen::Vector2f>> positions;
  /// Where the image of the reference shows the corners, where `positions` are those of a global
  /// shutter instead [px]; else empty.
  std::vector<Eigen::Vector2f> seen{};

  [[nodiscard]] int frames() const { return static_cast<int>(positions.size()); }
  [[nodiscard]] int size() const {
    return positions.empty() ? 0 : static_cast<int>(positions.front().size());
  }
  /// Removes tracks. @param dropped nonzero for those that go
  void drop(const std::vector<char>& dropped) {
    for (std::vector<Eigen::Vector2f>& frame : positions) eraseMarked(dropped, frame);
    eraseMarked(dropped, seen);
  }
  /// Matches between the reference and a later frame that sees all corners.
  [[nodiscard]] Matches matchesTo(int frame) const {
    Matches matches;
    matches.reference.reserve(positions.front().size());
    matches.target.reserve(positions.front().size());
    const auto& target = positions[static_cast<std::size_t>(frame)];
    for (std::size_t i = 0; i < target.size(); ++i) {
      matches.reference.emplace_back(positions.front()[i].cast<double>());
      matches.target.emplace_back(target[i].cast<double>());
    }
    return matches;
  }
};

}  // namespace dsorb
