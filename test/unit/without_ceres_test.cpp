// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/error.h"
#include "dsorb/init/initializer.h"

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

TEST(WithoutCeres, OptionsThatNeedItAreRefused) {
  const PinholeCamera camera{400, 400, 319.5, 239.5, 640, 480};
  const auto refusal = [&camera](auto change) {
    InitializerOptions options;
    change(options.orb);
    return errorOf([&] { (void)makeInitializer(options, camera); });
  };
  EXPECT_THAT(refusal([](OrbOptions& o) { o.geometric.solver = AdjustmentSolver::kCeres; }),
              AllOf(HasSubstr("orb.geometric.solver"), HasSubstr("DSORB_WITH_CERES")));
  EXPECT_THAT(refusal([](OrbOptions& o) { o.photometric.solver = AdjustmentSolver::kCeres; }),
              HasSubstr("orb.photometric.solver"));
  EXPECT_THAT(refusal([](OrbOptions& o) { o.tracks.flow = OpticalFlow::kOpenCv; }),
              HasSubstr("orb.tracks.flow"));
  EXPECT_THAT(refusal([](OrbOptions& o) { o.front_end = OrbFrontEnd::kDescriptors; }),
              HasSubstr("orb.front_end"));
}

}  // namespace
}  // namespace dsorb
