// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <nanobind/nanobind.h>

namespace dsorb::python {

// Each adds its part to the module; bindPriors comes before bindInitializer and that before
// bindOdometry, which need their types.
void bindCamera(nanobind::module_& m);
void bindPriors(nanobind::module_& m);
void bindInitializer(nanobind::module_& m);
void bindOdometry(nanobind::module_& m);

}  // namespace dsorb::python
