// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/initializer.h"

#include "python/arrays.h"

#include <cstdint>
#include <optional>
#include <utility>
#include <vector>

namespace dsorb::python {

/// Points as columns, so that Python sees them as arrays where they lie.
struct PointColumns {
  std::vector<std::int32_t> hosts;    ///< empty where all have one host
  std::vector<float> pixels;          ///< u v, u v, ... [px]
  std::vector<float> inverse_depths;  ///< [1/unit]
  std::vector<float> variances;       ///< [1/unit^2]
  std::vector<float> intensities;     ///< [grey levels]; empty where they are not known

  void add(const Eigen::Vector2f& pixel, float inverse_depth, float variance) {
    pixels.push_back(pixel.x());
    pixels.push_back(pixel.y());
    inverse_depths.push_back(inverse_depth);
    variances.push_back(variance);
  }
};

using Column = nb::ndarray<nb::numpy, float, nb::ndim<1>>;
using Hosts = nb::ndarray<nb::numpy, std::int32_t, nb::ndim<1>>;
using Pixels = nb::ndarray<nb::numpy, float, nb::shape<-1, 2>>;

template <typename Class>
void bindPoints(Class& type) {
  using T = typename Class::Type;
  type.def_prop_ro(
          "pixels",
          [](T& t) {
            return Pixels(t.points.pixels.data(), {t.points.inverse_depths.size(), 2});
          },
          nb::rv_policy::reference_internal,
          "(n, 2): column and row in the host [px].")
      .def_prop_ro(
          "inverse_depths",
          [](T& t) {
            return Column(t.points.inverse_depths.data(), {t.points.inverse_depths.size()});
          },
          nb::rv_policy::reference_internal,
          "(n,): along the host's optical axis [1/unit].")
      .def_prop_ro(
          "variances",
          [](T& t) { return Column(t.points.variances.data(), {t.points.variances.size()}); },
          nb::rv_policy::reference_internal,
          "(n,): of the inverse depths [1/unit^2]; 0: unknown.");
}

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
