// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/error.h"

#include "python/bind.h"

#include <cstring>
#include <exception>

namespace {

/// Files and their names may hold bytes that are no UTF-8.
void raise(const nanobind::object& type, const char* what) {
  PyObject* text =
      PyUnicode_DecodeUTF8(what, static_cast<Py_ssize_t>(std::strlen(what)), "backslashreplace");
  PyErr_SetObject(type.ptr(), text);
  Py_XDECREF(text);
}

}  // namespace

NB_MODULE(_dsorb, m) {
  m.doc() = "Monocular direct visual odometry, started from features.";
  m.attr("__version__") = DSORB_VERSION;
  static const nanobind::exception<dsorb::ConfigError> config_error(
      m, "ConfigError", PyExc_ValueError);
  static const nanobind::exception<dsorb::IoError> io_error(m, "IoError", PyExc_RuntimeError);
  nanobind::register_exception_translator([](const std::exception_ptr& thrown, void* /*payload*/) {
    try {
      std::rethrow_exception(thrown);
    } catch (const dsorb::ConfigError& error) {
      raise(config_error, error.what());
    } catch (const dsorb::IoError& error) {
      raise(io_error, error.what());
    }
  });
  dsorb::python::bindCamera(m);
  dsorb::python::bindPriors(m);
  dsorb::python::bindInitializer(m);
  dsorb::python::bindOdometry(m);
}
