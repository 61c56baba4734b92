// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/published/registration.h"

#include "dsorb/error.h"
#include "dsorb/init/initializer.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

namespace dsorb::published {
namespace {

using testing::HasSubstr;

TEST(Registration, MakesTheVariantsKnownOnce) {
  registerInitializers();
  registerInitializers();
  EXPECT_THAT(initializerVariants(),
              testing::ElementsAre("coarse", "orb", "orb-matching", "orb-v1", "orb-v2", "orb-v3"));
  const PinholeCamera camera{400, 400, 319.5, 239.5, 640, 480};
  for (const char* name : kPublishedVariants) {
    EXPECT_TRUE(makeInitializer(initializerVariant(name), camera)) << name;
  }
}

TEST(Registration, AReferenceThatIsGivenUpBeforeItMayBeTriedIsRefused) {
  registerInitializers();
  const PinholeCamera camera{400, 400, 319.5, 239.5, 640, 480};
  InitializerOptions options = initializerVariant("orb-v1");
  options.published.min_frames = 9;
  options.published.max_frames = 8;
  try {
    (void)makeInitializer(options, camera);
    FAIL() << "accepted";
  } catch (const ConfigError& error) {
    EXPECT_THAT(error.what(), HasSubstr("published.min_frames = 9"));
  }
}

}  // namespace
}  // namespace dsorb::published
