// SPDX-License-Identifier: BSD-3-Clause
// A library that is loaded with the program brings an initializer of its own.
#include "support/dso_dataset_run.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace dsorb {
namespace {

TEST_F(DsoDataset, FindsTheInitializerOfAPreloadedLibrary) {
  const std::string run = " $dso " + room_.string() + " --output out --quiet --initializer=mine";
  const ProgramResult without = shell(run);
  EXPECT_EQ(without.exit_code, 2);
  EXPECT_THAT(without.err, ::testing::HasSubstr("mine"));
  const ProgramResult with = shell("LD_PRELOAD=" DSORB_PRELOADED + run);
  ASSERT_EQ(with.exit_code, 0) << with.err;
  EXPECT_EQ(runJson()["initializer"], "mine");
  EXPECT_EQ(runJson()["segments"], 1);
}

}  // namespace
}  // namespace dsorb
