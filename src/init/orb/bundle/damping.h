// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>

namespace dsorb::init_orb {

/// Damping of Levenberg-Marquardt, relative to the diagonal: falls with the agreement of cost and
/// prediction, rises faster and faster without.
/// @source Madsen, Nielsen, Tingleff, Methods for Non-Linear Least Squares Problems, algorithm 3.16
struct Damping {
  double value = 1e-4;  ///< first: Ceres' trust region of radius 1e4
  double growth = 2;

  /// @param gain decrease of the cost over the predicted one
  void succeed(double gain) {
    const double x = 2 * gain - 1;
    value *= std::max(1.0 / 3, 1 - x * x * x);
    growth = 2;
  }
  void fail() {
    value *= growth;
    growth *= 2;
  }
  /// No step lowers the cost any more.
  [[nodiscard]] bool exhausted() const { return value > 1e16; }
};

}  // namespace dsorb::init_orb
