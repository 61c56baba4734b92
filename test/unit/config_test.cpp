// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/io/config.h"

#include "dsorb/error.h"

#include "base/describe.h"
#include "io/calibration/keyed_values.h"
#include "io/presets.h"
#include "support/published_variants.h"
#include "support/reference_coarse_options.h"
#include "support/temporary_folder.h"
#include "support/text_files.h"

#include <gmock/gmock.h>

#include <fstream>

namespace dsorb {
namespace {

using ::testing::AllOf;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

std::string writeFile(const TemporaryFolder& folder,
                      const std::string& name,
                      const std::string& text) {
  const std::string path = (folder.path() / name).string();
  std::ofstream(path) << text;
  return path;
}

Config loadText(const std::string& yaml) {
  const TemporaryFolder folder;
  ConfigSources sources;
  sources.files = {writeFile(folder, "test.yaml", yaml)};
  return loadConfig(sources);
}

Config loadSet(const std::string& assignment) {
  ConfigSources sources;
  sources.assignments = {parseAssignment(assignment, "--set")};
  return loadConfig(sources);
}

template <typename Load>
std::string errorOf(const Load& load) {
  try {
    load();
  } catch (const ConfigError& error) {
    return error.what();
  }
  return "no ConfigError";
}

/// Another valid value of the field.
void perturb(OptionField& field) {
  const auto other = [&field](auto value) {
    using Number = decltype(value);
    const double middle = 0.5 * (field.range.low + field.range.high);
    const auto candidate = static_cast<Number>(middle);
    return candidate == value ? static_cast<Number>(field.range.high) : candidate;
  };
  if (auto* choice = std::get_if<Choice>(&field.value)) {
    choice->set((choice->get().value() + 1) % choice->names.size());
  } else if (auto* flag = std::get_if<bool*>(&field.value)) {
    **flag = !**flag;
  } else if (auto* whole = std::get_if<int*>(&field.value)) {
    **whole = other(**whole);
  } else if (auto* single = std::get_if<float*>(&field.value)) {
    **single = other(**single);
  } else {
    double& number = *std::get<double*>(field.value);
    number = other(number);
  }
}

TEST(Config, EveryPerturbedOptionSurvivesYaml) {
  Config config;
  std::size_t changed = 0;
  auto fields = listFields(config.options);
  for (OptionField& field : fields) {
    const auto* choice = std::get_if<Choice>(&field.value);
    if (choice != nullptr && choice->names.size() < 2) continue;  // nothing else to choose yet
    perturb(field);
    ++changed;
  }
  config.options.initializer.kind = OdometryOptions{}.initializer.kind;  // follows the variant
  const Config loaded = loadText(toYaml(config));
  EXPECT_THAT(differingKeys(config.options, loaded.options), IsEmpty());
  EXPECT_GE(differingKeys(OdometryOptions{}, loaded.options).size() + 1, changed);
}

TEST(Config, DefaultPresetHoldsEveryKeyWithTheDefaultOfItsStruct) {
  const auto& presets = io::presets();
  const auto found = std::find_if(presets.begin(), presets.end(), [](const io::Preset& preset) {
    return std::string(preset.name) == "default";
  });
  ASSERT_NE(found, presets.end());
  EXPECT_EQ(found->yaml, toYaml(Config{}))
      << "write it anew: dso_dataset --threads 1 --print-config > configs/default.yaml";
}

TEST(Config, ReferencePresetHoldsWhatWasPublished) {
  ConfigSources sources;
  sources.preset = "reference";
  const OdometryOptions options = loadConfig(sources).options;
  EXPECT_THAT(differingKeys(options.initializer.coarse, referenceCoarseOptions()), IsEmpty());
  OdometryOptions rest = options;
  rest.initializer = {};
  EXPECT_THAT(differingKeys(OdometryOptions{}, rest),
              ::testing::UnorderedElementsAre("max_refusals",
                                              "max_missed",
                                              "tracker.min_inside_fraction",
                                              "tracker.max_gain_step",
                                              "tracker.max_rmse",
                                              "depth.candidates_per_keyframe",
                                              "depth.min_improvement",
                                              "depth.published",
                                              "window.first_keyframes",
                                              "window.published",
                                              "window.optimizer.min_decrease",
                                              "window.optimizer.optimize_intrinsics",
                                              "window.prior.intrinsics",
                                              "window.prior.depth_gain"));
}

TEST(Config, FastPresetWantsLess) {
  ConfigSources sources;
  sources.preset = "fast";
  const OdometryOptions options = loadConfig(sources).options;
  EXPECT_EQ(options.window.desired_points, 800);
  EXPECT_EQ(options.depth.candidates_per_keyframe, 600);
}

TEST(Config, LaterSourcesWin) {
  const TemporaryFolder folder;
  ConfigSources sources;
  sources.program_defaults = {{"num_threads", "0", "program"}};
  EXPECT_EQ(loadConfig(sources).options.num_threads, 0);
  sources.files = {writeFile(folder, "a.yaml", "num_threads: 2\ninitializer:\n  seed: 5\n"),
                   writeFile(folder, "b.yaml", "num_threads: 3\n")};
  EXPECT_EQ(loadConfig(sources).options.num_threads, 3);
  sources.assignments = {parseAssignment("num_threads=4", "--set")};
  EXPECT_EQ(loadConfig(sources).options.num_threads, 4);
  sources.flags = {{"num_threads", "5", "--threads"}};
  EXPECT_EQ(loadConfig(sources).options.num_threads, 5);
  EXPECT_EQ(loadConfig(sources).options.initializer.seed, 5);
}

TEST(Config, LastToNameAVariantDecidesAndOtherKeysComeOnTop) {
  ConfigSources sources;
  sources.assignments = {parseAssignment("initializer.kind=orb", "--set"),
                         parseAssignment("orb.min_frames=7", "--set")};
  EXPECT_EQ(loadConfig(sources).initializer, "orb");
  sources.flags = {{"initializer.kind", "orb-v1", "--initializer"}};
  const Config config = loadConfig(sources);
  EXPECT_EQ(config.initializer, "orb-v1");
  EXPECT_EQ(config.options.initializer.orb.min_frames, 7);
}

TEST(Config, VariantNameSurvivesYaml) {
  Config config;
  config.initializer = "orb-v1";
  EXPECT_EQ(loadText(toYaml(config)).initializer, "orb-v1");
}

TEST(Config, UnknownKeyNamesFileLineAndClosestKey) {
  EXPECT_THAT(errorOf([] { loadText("# note\ninitializer:\n  orb:\n    min_frame: 3\n"); }),
              AllOf(HasSubstr("test.yaml:4: unknown key 'initializer.orb.min_frame'"),
                    HasSubstr("'initializer.orb.min_frames'")));
  EXPECT_THAT(errorOf([] { loadSet("num_thread=2"); }),
              AllOf(HasSubstr("--set: unknown key 'num_thread'"), HasSubstr("'num_threads'")));
  EXPECT_THAT(errorOf([] { loadSet("orb.min_frmes=3"); }),
              HasSubstr("the closest valid key is 'initializer.orb.min_frames'"));
}

TEST(Config, OutOfRangeAndWrongTypeNameTheRange) {
  EXPECT_THAT(errorOf([] { loadText("num_threads: -1\n"); }),
              AllOf(HasSubstr("test.yaml:1: num_threads = '-1'"),
                    HasSubstr("a whole number in [0, 1024] threads")));
  for (const char* value : {"2.5", "two", "", "nan", "2 3", "99999999999"}) {
    EXPECT_THAT(errorOf([value] { loadSet(std::string("num_threads=") + value); }),
                HasSubstr("must be a whole number"))
        << value;
  }
  EXPECT_THAT(errorOf([] { loadSet("orb.geometric.sigma=nan"); }),
              HasSubstr("must be a number in"));
  EXPECT_THAT(errorOf([] { loadSet("orb.geometric.loss=best"); }),
              HasSubstr("must be one of huber, cauchy"));
}

TEST(Config, UnknownVariantAndPresetNameThoseThereAre) {
  EXPECT_THAT(errorOf([] { loadSet("initializer.kind=orb-v9"); }),
              AllOf(HasSubstr("orb-v9"), HasSubstr("orb-v1")));
  ConfigSources sources;
  sources.preset = "fastest";
  EXPECT_THAT(errorOf([&sources] { (void)loadConfig(sources); }),
              AllOf(HasSubstr("--preset fastest"), HasSubstr("default")));
}

TEST(Config, MalformedYamlNamesTheLine) {
  EXPECT_THAT(errorOf([] { loadText("num_threads: 2\n  bad: [\n"); }), HasSubstr("test.yaml:2"));
  EXPECT_THAT(errorOf([] { loadText("- 1\n- 2\n"); }), HasSubstr("lines of 'key: value'"));
  EXPECT_THAT(errorOf([] { loadText("num_threads: [1, 2]\n"); }), HasSubstr("test.yaml:1"));
  EXPECT_THAT(errorOf([] { loadText("num_threads: 1\nnum_threads: 2\n"); }),
              AllOf(HasSubstr("test.yaml:2"), HasSubstr("given twice")));
  ConfigSources sources;
  sources.files = {"/nowhere/missing.yaml"};
  EXPECT_THAT(errorOf([&sources] { (void)loadConfig(sources); }),
              HasSubstr("/nowhere/missing.yaml: cannot be opened for reading: No such file"));
}

TEST(Config, AliasesDepthAndSizeAreLimitedBeforeAnythingIsBuilt) {
  EXPECT_THAT(errorOf([] { loadText("a: &a\n  b: *a\n"); }),
              HasSubstr("test.yaml:1: more than 32 groups within each other"));
  std::string bomb = "a0: &a0 {x: 1}\n";
  for (int i = 1; i < 30; ++i) {
    const std::string before = "*a" + std::to_string(i - 1);
    bomb += "a" + std::to_string(i) + ": &a" + std::to_string(i) + " {";
    for (int k = 0; k < 9; ++k) bomb += "k" + std::to_string(k) + ": " + before + ", ";
    bomb += "}\n";
  }
  EXPECT_THAT(errorOf([&bomb] { loadText(bomb); }),
              AllOf(HasSubstr("test.yaml:"), HasSubstr("more than 100000 values")));
  EXPECT_THAT(errorOf([] { loadText("a: " + std::string(40, '[') + std::string(40, ']')); }),
              HasSubstr("test.yaml:1: more than 32 groups within each other"));
  EXPECT_EQ(loadText("initializer:\n  seed: &n 3\nnum_threads: *n\n").options.num_threads, 3);
}

TEST(Config, ParserThatStaysWhereItIsEnds) {
  for (const char* text : {",", "\n\n, num_threads: 2", "# comment\n]"}) {
    EXPECT_THAT(errorOf([&text] { loadText(text); }), HasSubstr("not YAML")) << text;
  }
}

TEST(Config, SecondDocumentOfAFileIsRefused) {
  EXPECT_THAT(errorOf([] { loadText("num_threads: 1\n---\nnum_threads: 2\n"); }),
              HasSubstr("test.yaml:3: a second document begins"));
  EXPECT_EQ(loadText("---\nnum_threads: 2\n").options.num_threads, 2);
}

TEST(Config, GroupIsNoShortFormOfAnotherOption) {
  EXPECT_THAT(errorOf([] { loadText("num_threads: 1\nwindow: 21\n"); }),
              AllOf(HasSubstr("test.yaml:2: 'window' is a group of keys"), HasSubstr("'window.")));
}

TEST(Config, AmbiguousEndOfAKeyIsRefused) {
  EXPECT_THAT(errorOf([] { loadSet("max_frames=60"); }), HasSubstr("could be"));
}

TEST(Config, AssignmentNeedsKeyAndEqualsSign) {
  EXPECT_THAT(errorOf([] { loadSet("num_threads"); }), HasSubstr("expected key=value"));
  EXPECT_THAT(errorOf([] { loadSet("=2"); }), HasSubstr("expected key=value"));
}

TEST(ClosestName, HasTheSmallestEditDistance) {
  const std::vector<std::string> names = {"huber", "seed", "weight"};
  EXPECT_EQ(closestName("hubber", names), "huber");
  EXPECT_EQ(closestName("wieght", names), "weight");
  EXPECT_EQ(closestName("", names), "seed");
  EXPECT_EQ(closestName("x", {}), "");
}

}  // namespace
}  // namespace dsorb
