// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

namespace dsorb::app {

/// Puts /dev/null where standard input, output or error are closed: the next file opened would get
/// that number, and what is printed would land in it. Call it before any file is opened.
void openStandardStreams();

/// Prints a text that the user asked for.
/// @throws std::system_error where not all of it arrives
void printText(const std::string& text);

/// Writing fails by an error that can be reported, not by a signal that ends the program: where the
/// reader of its output has closed the pipe (`| head`), and where a file exceeds its limit.
void ignoreWriteSignals();

}  // namespace dsorb::app
