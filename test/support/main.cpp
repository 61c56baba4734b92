// SPDX-License-Identifier: BSD-3-Clause
/// Runs the tests of a program; with --file=NAME only those that stand in NAME.cpp, so that ctest
/// can have an entry for every source file.
#include <gmock/gmock.h>

#include <filesystem>
#include <iostream>
#include <string>
#include <string_view>

#ifndef GTEST_FLAG_GET  // GoogleTest before 1.12
#define GTEST_FLAG_GET(name) testing::GTEST_FLAG(name)
#define GTEST_FLAG_SET(name, value) (testing::GTEST_FLAG(name) = (value))
#endif

namespace {

/// Takes the tests of all other files out of GoogleTest's filter; false where the file has no test.
bool keepOnlyTestsOf(std::string_view file) {
  const testing::UnitTest& all = *testing::UnitTest::GetInstance();
  std::string filter = GTEST_FLAG_GET(filter);
  filter += filter.find('-') == std::string::npos ? "-" : ":";
  bool found = false;
  for (int s = 0; s < all.total_test_suite_count(); ++s) {
    const testing::TestSuite& suite = *all.GetTestSuite(s);
    for (int t = 0; t < suite.total_test_count(); ++t) {
      const testing::TestInfo& test = *suite.GetTestInfo(t);
      if (std::filesystem::path(test.file()).stem() == file) {
        found = true;
      } else {
        filter += std::string(suite.name()) + "." + test.name() + ":";
      }
    }
  }
  GTEST_FLAG_SET(filter, filter);
  return found;
}

}  // namespace

int main(int argc, char** argv) {
  testing::InitGoogleMock(&argc, argv);
  constexpr std::string_view kFile = "--file=";
  for (int i = 1; i < argc; ++i) {
    const std::string_view argument = argv[i];
    if (argument.substr(0, kFile.size()) != kFile ||
        !keepOnlyTestsOf(argument.substr(kFile.size()))) {
      std::cerr << argument << ": no option, or no file with tests\n";
      return 2;
    }
  }
  return RUN_ALL_TESTS();
}
