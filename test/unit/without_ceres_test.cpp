// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/error.h"
#include "dsorb/options/initializer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace dsorb {
namespace {

using testing::AllOf;
using testing::HasSubstr;

template <typename Call>
std::string errorOf(Call call) {
  try {
    call();
  } catch (const ConfigError& error) {
    return error.what();
  }
  return "no error";
}

TEST(WithoutCeres, HasOrbAndCoarse) {
  EXPECT_THAT(initializerVariants(), testing::ElementsAre("coarse", "orb"));
}

TEST(WithoutCeres, OtherVariantsSayWhatTheyNeed) {
  for (const char* name : {"orb-v1", "orb-v2", "orb-v3", "orb-matching"}) {
    EXPECT_THAT(errorOf([name] { (void)initializerVariant(name); }),
                AllOf(HasSubstr(name), HasSubstr("DSORB_WITH_CERES"), HasSubstr("coarse orb")));
  }
}

}  // namespace
}  // namespace dsorb
