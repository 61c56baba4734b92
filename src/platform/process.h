// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

/// This process and its standard streams: process_posix.cpp, process_windows.cpp.
namespace dsorb::platform {

/// Largest resident memory so far [MiB]. Where the system tells it, the mark begins anew with the
/// program: it is not that of whoever started it.
[[nodiscard]] double peakMemory();

[[nodiscard]] std::int64_t processId();

/// Whether standard error is a terminal.
[[nodiscard]] bool errorIsTerminal();

/// Puts the null device where standard input, output or error are closed: the next file opened
/// would get that number, and what is printed would land in it. Call it before any file is opened.
void openStandardStreams();

/// Writing fails by an error that can be reported, not by a signal that ends the program: where the
/// reader of its output has closed the pipe (`| head`), and where a file exceeds its limit.
void ignoreWriteSignals();

/// Ends the process at once: nothing is destroyed or flushed.
[[noreturn]] void endNow(int code);

}  // namespace dsorb::platform
