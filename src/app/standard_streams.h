// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

namespace dsorb::app {

/// Prints a text that the user asked for.
/// @throws std::system_error where not all of it arrives
void printText(const std::string& text);

}  // namespace dsorb::app
