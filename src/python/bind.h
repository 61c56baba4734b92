// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <nanobind/nanobind.h>
#include <nanobind/stl/string.h>

#include <string>
#include <vector>

namespace dsorb::python {

// Each adds its part to the module; bindPriors comes before bindInitializer and that before
// bindOdometry, which need their types.
void bindCamera(nanobind::module_& m);
void bindPriors(nanobind::module_& m);
void bindInitializer(nanobind::module_& m);
void bindOdometry(nanobind::module_& m);

/// Binds __repr__: the name of the class with some of its attributes.
template <typename T>
void bindRepr(nanobind::class_<T>& type, const std::vector<const char*>& attributes) {
  type.def("__repr__", [attributes](nanobind::handle self) {
    std::string text = nanobind::str(self.type().attr("__name__")).c_str();
    const char* separator = "(";
    for (const char* name : attributes) {
      text += std::string(separator) + name + "=" + nanobind::repr(self.attr(name)).c_str();
      separator = ", ";
    }
    return text + (attributes.empty() ? "()" : ")");
  });
}

}  // namespace dsorb::python
