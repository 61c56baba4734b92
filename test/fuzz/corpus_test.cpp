// SPDX-License-Identifier: BSD-3-Clause
// Feeds the parsers with the inputs that a fuzzer started from and with those that it broke them
// with.
#include "fuzz/parsers.h"
#include "support/text_files.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <filesystem>

namespace dsorb {
namespace {

namespace fs = std::filesystem;

TEST(FuzzCorpus, EveryInputIsReadOrRefused) {
  using Clock = std::chrono::steady_clock;
  for (const fuzz::Parser& parser : fuzz::parsers()) {
    int inputs = 0;
    for (const auto& entry : fs::directory_iterator(fs::path(DSORB_CORPUS) / parser.name)) {
      const std::string bytes = readText(entry.path());
      const Clock::time_point begin = Clock::now();
      EXPECT_NO_THROW(
          parser.feed(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()))
          << entry.path();
      // None takes .1 s; those that once took for ever are among them.
      EXPECT_LT(std::chrono::duration<double>(Clock::now() - begin).count(), 5) << entry.path();
      ++inputs;
    }
    EXPECT_GT(inputs, 0) << parser.name;
  }
}

}  // namespace
}  // namespace dsorb
