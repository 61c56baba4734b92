// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/io/config.h"

#include "python/frame_source.h"

#include <nanobind/nanobind.h>

#include <string>

namespace dsorb::python {

/// Options of a call: the preset, then the entries of a dictionary and the keyword arguments, which
/// have the names of the keys of configs/default.yaml, nested or dotted. As in the program, all
/// threads of the machine are used where num_threads does not say otherwise.
/// @param initializer name of a variant, or a dictionary of the group `initializer`
/// @throws ConfigError as loadConfig()
Config configOf(nanobind::handle initializer,
                const std::string& preset,
                nanobind::handle options,
                const nanobind::kwargs& words);

/// Binds a constructor of what is made from a FrameSource and a Config.
template <typename Camera, typename Bound>
void bindMakerFrom(nanobind::class_<Bound>& type, const char* text) {
  namespace nb = nanobind;
  type.def(
      "__init__",
      [](Bound* self,
         const Camera& camera,
         nb::handle initializer,
         const std::string& preset,
         nb::handle options,
         const nb::kwargs& words) {
        new (self) Bound(FrameSource(camera), configOf(initializer, preset, options, words));
      },
      nb::arg("camera"),
      nb::arg("initializer") = nb::none(),
      nb::kw_only(),
      nb::arg("preset") = "default",
      nb::arg("options") = nb::none(),
      nb::arg("words"),
      text);
}

/// Binds the constructors: from a camera, and from the rectifier that makes the images.
template <typename Bound>
void bindMaker(nanobind::class_<Bound>& type, const char* text) {
  bindMakerFrom<PinholeCamera>(type, text);
  bindMakerFrom<LockedRectifier>(type,
                                 "From the Rectifier that makes the images: its camera, with the "
                                 "times of the rows where the calibration has a readout, and the "
                                 "response.");
}

/// Binds a method that takes the next frame, and whether others wait behind it.
template <typename Bound, typename Method>
void bindFeeder(nanobind::class_<Bound>& type, const char* name, Method method, const char* text) {
  namespace nb = nanobind;
  type.def(name,
           method,
           nb::arg("image"),
           nb::arg("timestamp"),
           nb::arg("id") = nb::none(),
           nb::arg("exposure") = 1.0,
           nb::arg("priors") = nb::none(),
           text)
      .def_prop_rw(
          "hurried",
          [](const Bound& bound) { return bound.hurried.load(); },
          [](Bound& bound, bool hurried) { bound.hurried = hurried; },
          "Whether other images wait behind the next one already: orb then follows its corners and "
          "puts an attempt to start off.");
}

}  // namespace dsorb::python
