// SPDX-License-Identifier: BSD-3-Clause
// One program for all parsers: the environment variable DSORB_FUZZ names the one to be fed.
#include "fuzz/parsers.h"

#include <cstdio>
#include <cstdlib>
#include <string>

namespace {

const dsorb::fuzz::Parser* chosen = nullptr;

}  // namespace

extern "C" int LLVMFuzzerInitialize(int* /*argc*/, char*** /*argv*/) {
  const char* variable = std::getenv("DSORB_FUZZ");
  const std::string name = variable == nullptr ? "" : variable;
  for (const dsorb::fuzz::Parser& parser : dsorb::fuzz::parsers()) {
    if (parser.name == name) chosen = &parser;
  }
  if (chosen != nullptr) return 0;
  std::fprintf(stderr, "DSORB_FUZZ=NAME is needed, one of:\n");
  for (const dsorb::fuzz::Parser& parser : dsorb::fuzz::parsers()) {
    std::fprintf(stderr, "  %s\n", parser.name);
  }
  return std::exit(2), 0;
}

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* bytes, std::size_t size) {
  chosen->feed(bytes, size);
  return 0;
}
