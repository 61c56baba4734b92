// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdlib>
#include <filesystem>
#include <string>

namespace dsorb {

/// Folder of the real sequences: the environment variable DSORB_DATA, else ../shared/data beside
/// the project. Tests skip themselves where the part they need does not exist.
inline std::filesystem::path realData(const std::string& part) {
  const char* chosen = std::getenv("DSORB_DATA");
  const auto project = std::filesystem::path(__FILE__).parent_path().parent_path().parent_path();
  return (chosen != nullptr ? std::filesystem::path(chosen)
                            : project.parent_path() / "shared" / "data") /
         part;
}

}  // namespace dsorb
