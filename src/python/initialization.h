// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/initializer.h"

#include "python/points.h"

#include <optional>
#include <utility>
#include <vector>

namespace dsorb::python {

/// One of the frames of a start, without its image.
struct StartFrame {
  int id = 0;
  double timestamp = 0;
  std::optional<SE3> T_cam_ref;
  AffineBrightness affine;
  std::optional<Matrix6d> covariance;
};

/// A start as Python sees it.
struct Initialization {
  explicit Initialization(const InitializationResult& result);
  std::vector<StartFrame> frames;
  PointColumns points;
  InitReport report;
  std::optional<MetricScale> metric;
  std::vector<std::pair<float, float>> stuck;
};

}  // namespace dsorb::python
