// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include <cstddef>
#include <vector>

namespace dsorb::init_orb {

/// Pixels of the same corners in two images [px]; equal lengths.
struct Matches {
  std::vector<Eigen::Vector2d> reference;
  std::vector<Eigen::Vector2d> target;

  [[nodiscard]] std::size_t size() const { return reference.size(); }
};

}  // namespace dsorb::init_orb
