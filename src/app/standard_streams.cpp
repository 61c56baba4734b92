// SPDX-License-Identifier: BSD-3-Clause
#include "app/standard_streams.h"

#include <cerrno>
#include <cstdio>
#include <system_error>

namespace dsorb::app {

void printText(const std::string& text) {
  if (std::fputs(text.c_str(), stdout) < 0 || std::fflush(stdout) != 0) {
    throw std::system_error(errno, std::generic_category(), "standard output");
  }
}

}  // namespace dsorb::app
