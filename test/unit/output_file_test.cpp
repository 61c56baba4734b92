// SPDX-License-Identifier: BSD-3-Clause
#include "io/output/output_file.h"

#include "dsorb/error.h"

#include "support/temporary_folder.h"
#include "support/text_files.h"

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <csignal>
#include <filesystem>
#include <limits>
#include <random>

namespace dsorb {
namespace {

TEST(GrowingFile, FullDiskIsAnError) {
  if (!std::filesystem::exists("/dev/full")) GTEST_SKIP() << "no /dev/full on this system";
  io::GrowingFile file("/dev/full");
  EXPECT_THROW(file.append("text"), IoError);
}

TEST(GrowingFile, RecordsAreThereAtOnceAndMayBeOverwritten) {
  const TemporaryFolder folder;
  const std::filesystem::path path = folder.path() / "file.txt";
  io::GrowingFile file(path);
  file.append("head one");
  EXPECT_EQ(readText(path), "head one");
  file.write(0, "HEAD");
  file.append(" two");
  EXPECT_EQ(readText(path), "HEAD one two");
  EXPECT_EQ(file.read(5, 3), "one");
}

TEST(ReplaceFile, OldContentStaysWhereTheNewOneCannotBeWritten) {
  const TemporaryFolder folder;
  const std::filesystem::path path = folder.path() / "file.txt";
  io::replaceFile(path, "old");
  std::filesystem::create_directory(path.string() + ".part");
  EXPECT_THROW(io::replaceFile(path, "new"), IoError);
  EXPECT_EQ(readText(path), "old");
  std::filesystem::remove(path.string() + ".part");
  io::replaceFile(path, "new");
  EXPECT_EQ(readText(path), "new");
  EXPECT_FALSE(std::filesystem::exists(path.string() + ".part"));
}

TEST(JsonText, KeepsArraysOfNumbersOnOneLineAndReadsBack) {
  const io::Json json = {{"a", {1, 2.5}}, {"b", {{1, 2}, {3, 4}}}, {"c", io::Json::object()}};
  const std::string text = io::jsonText(json);
  EXPECT_EQ(text, "{\n \"a\": [1,2.5],\n \"b\": [\n  [1,2],\n  [3,4]\n ],\n \"c\": {}\n}\n");
  EXPECT_EQ(io::Json::parse(text), json);
  EXPECT_EQ(io::jsonText({{"x", std::numeric_limits<double>::quiet_NaN()}}),
            "{\n \"x\": null\n}\n");
}

TEST(JsonText, TimestampsAreFixedWithNineDecimals) {
  EXPECT_EQ(io::jsonText({{"timestamp", 1e-5}, {"other", 1e-5}}),
            "{\n \"timestamp\": 0.000010000,\n \"other\": 1e-05\n}\n");
}

TEST(JsonText, FloatsKeepTheirShortText) {
  EXPECT_EQ(io::shortest(0.1F), 0.1);
}

}  // namespace
}  // namespace dsorb
