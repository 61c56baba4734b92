// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/error.h"
#include "dsorb/published/registration.h"

#include "python/bind.h"
#include "python/unlocked.h"

#include <cstring>
#include <exception>

namespace {

/// Files and their names may hold bytes that are no UTF-8.
template <typename Error>
void raise(const std::exception_ptr& thrown, void* type) {
  try {
    std::rethrow_exception(thrown);
  } catch (const Error& error) {
    const auto length = static_cast<Py_ssize_t>(std::strlen(error.what()));
    PyObject* text = PyUnicode_DecodeUTF8(error.what(), length, "backslashreplace");
    PyErr_SetObject(static_cast<PyObject*>(type), text);
    Py_XDECREF(text);
  }
}

template <typename Error>
void addError(nanobind::module_& m, const char* name, PyObject* base) {
  const nanobind::exception<Error> error(m, name, base);
  nanobind::register_exception_translator(raise<Error>, error.ptr());
}

}  // namespace

NB_MODULE(_dsorb, m) {
#ifdef DSORB_WITH_PUBLISHED
  dsorb::published::registerInitializers();
#endif
  m.doc() = "Monocular direct visual odometry, started from features.";
  m.attr("__version__") = DSORB_VERSION;
  nanobind::set_leak_warnings(false);  // of objects that are alive when the interpreter ends
  dsorb::python::waitAtExit();
  addError<dsorb::ConfigError>(m, "ConfigError", PyExc_ValueError);
  addError<dsorb::IoError>(m, "IoError", PyExc_RuntimeError);
  dsorb::python::bindCamera(m);
  dsorb::python::bindPriors(m);
  dsorb::python::bindInitializer(m);
  dsorb::python::bindOdometry(m);
}
