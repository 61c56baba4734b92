// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/error.h"

#include "python/bind.h"

NB_MODULE(_dsorb, m) {
  m.doc() = "Monocular direct visual odometry, started from features.";
  m.attr("__version__") = DSORB_VERSION;
  const nanobind::exception<dsorb::ConfigError> config_error(m, "ConfigError", PyExc_ValueError);
  const nanobind::exception<dsorb::IoError> io_error(m, "IoError", PyExc_RuntimeError);
  dsorb::python::bindCamera(m);
  dsorb::python::bindPriors(m);
  dsorb::python::bindInitializer(m);
  dsorb::python::bindOdometry(m);
}
