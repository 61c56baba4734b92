// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <nanobind/nanobind.h>

namespace dsorb::python {

// Each adds its part to the module; bindInitializer comes before bindOdometry, which needs its
// types.
void bindCamera(nanobind::module_& m);
void bindInitializer(nanobind::module_& m);
void bindOdometry(nanobind::module_& m);

}  // namespace dsorb::python
