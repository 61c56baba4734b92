// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

namespace dsorb::io {

/// A file of configs/, compiled into the library.
struct Preset {
  const char* name;
  const char* yaml;
};

[[nodiscard]] const std::vector<Preset>& presets();

}  // namespace dsorb::io
