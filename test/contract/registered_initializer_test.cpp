// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/error.h"
#include "dsorb/init/registry.h"
#include "dsorb/io/config.h"

#include "support/published_variants.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <thread>

namespace dsorb {
namespace {

using testing::AllOf;
using testing::Contains;
using testing::HasSubstr;
using testing::Not;

const PinholeCamera kCamera{400, 400, 319.5, 239.5, 640, 480};

/// Never initializes; remembers the seed it was made with.
class Waiting : public Initializer {
 public:
  explicit Waiting(int seed) : seed_(seed) {}
  InitStep addFrame(FramePtr /*frame*/) override { return {}; }
  void reset() override {}
  [[nodiscard]] int seed() const { return seed_; }

 private:
  int seed_;
};

std::unique_ptr<Initializer> makeWaiting(const InitializerOptions& options,
                                         const PinholeCamera& /*camera*/) {
  return std::make_unique<Waiting>(options.seed);
}

template <typename Call>
std::string errorOf(Call call) {
  try {
    call();
  } catch (const std::exception& error) {
    return error.what();
  }
  return "no error";
}

TEST(RegisteredInitializer, IsMadeByItsNameWithTheCallersOptions) {
  const RegisteredInitializer registered("waiting", makeWaiting);
  EXPECT_THAT(initializerVariants(), Contains("waiting"));
  InitializerOptions options = initializerVariant("waiting");
  options.seed = 42;
  const auto made = makeInitializer(options, kCamera);
  const auto* waiting = dynamic_cast<const Waiting*>(made.get());
  ASSERT_NE(waiting, nullptr);
  EXPECT_EQ(waiting->seed(), 42);
}

TEST(RegisteredInitializer, IsFoundByFlagsAndYaml) {
  const RegisteredInitializer registered("waiting", makeWaiting);
  ConfigSources sources;
  sources.flags = {{"initializer.kind", "waiting", "--initializer"}};
  const Config config = loadConfig(sources);
  EXPECT_EQ(config.initializer, "waiting");
  EXPECT_NE(dynamic_cast<Waiting*>(makeInitializer(config.options.initializer, kCamera).get()),
            nullptr);
  EXPECT_THAT(toYaml(config), HasSubstr("kind: waiting"));
}

TEST(RegisteredInitializer, ANameBesideAnotherKindIsRefused) {
  InitializerOptions options;
  options.registered = "waiting";
  EXPECT_THAT(errorOf([&] { (void)makeInitializer(options, kCamera); }),
              HasSubstr("'waiting': expected the kind registered"));
}

TEST(RegisteredInitializer, IsGoneWithItsObject) {
  InitializerOptions options;
  {
    const RegisteredInitializer registered("waiting", makeWaiting);
    options = initializerVariant("waiting");
  }
  EXPECT_THAT(initializerVariants(), Not(Contains("waiting")));
  EXPECT_THAT(errorOf([&] { (void)makeInitializer(options, kCamera); }),
              AllOf(HasSubstr("'waiting'"), HasSubstr("coarse orb")));
}

TEST(RegisteredInitializer, UnknownNamesAreAnsweredWithThoseThereAre) {
  const RegisteredInitializer registered("waiting", makeWaiting);
  EXPECT_THAT(errorOf([] { (void)initializerVariant("wating"); }),
              AllOf(HasSubstr("'wating'"), HasSubstr("coarse orb"), HasSubstr(" waiting")));
}

TEST(RegisteredInitializer, RefusesNamesThatAreTakenOrEmptyAndEmptyFactories) {
  const RegisteredInitializer registered("waiting", makeWaiting);
  for (const char* name : {"waiting", "orb", "coarse", ""}) {
    EXPECT_THROW(RegisteredInitializer(name, makeWaiting), std::invalid_argument) << name;
  }
  EXPECT_THROW(RegisteredInitializer("empty", nullptr), std::invalid_argument);
  EXPECT_THAT(initializerVariants(), Contains("waiting")) << "a refusal took it away";
}

TEST(RegisteredInitializer, RefusesAFactoryThatMakesNothing) {
  const RegisteredInitializer registered(
      "nothing", [](const auto&, const auto&) { return std::unique_ptr<Initializer>(); });
  EXPECT_THROW((void)makeInitializer(initializerVariant("nothing"), kCamera), std::logic_error);
}

TEST(RegisteredInitializer, ComesAndGoesInSeveralThreads) {
  constexpr int kThreads = 4;
  constexpr int kRounds = 200;
  std::vector<int> made(kThreads, 0);
  std::vector<std::thread> threads;
  for (int t = 0; t < kThreads; ++t) {
    threads.emplace_back([t, &count = made[static_cast<std::size_t>(t)]] {
      const std::string name = "thread-" + std::to_string(t);
      for (int i = 0; i < kRounds; ++i) {
        const RegisteredInitializer registered(name, makeWaiting);
        if (makeInitializer(initializerVariant(name), kCamera)) ++count;
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_THAT(made, testing::Each(kRounds));
}

}  // namespace
}  // namespace dsorb
