// SPDX-License-Identifier: BSD-3-Clause
#include "app/command_line.h"

#include "dsorb/error.h"

#include <gmock/gmock.h>

namespace dsorb::app {
namespace {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

using Arguments = std::vector<const char*>;

CommandLine parse(const Arguments& arguments) {
  Arguments argv = {"dso_dataset"};
  argv.insert(argv.end(), arguments.begin(), arguments.end());
  return parseCommandLine(static_cast<int>(argv.size()), argv.data());
}

OdometryOptions optionsOf(const CommandLine& request) {
  return loadConfig(request.config).options;
}

std::string errorOf(const Arguments& arguments) {
  try {
    (void)parse(arguments);
  } catch (const ConfigError& error) {
    return error.what();
  }
  return "no ConfigError";
}

TEST(CommandLine, DefaultsAreThoseOfTheContract) {
  const CommandLine request = parse({"data/street"});
  EXPECT_EQ(request.sequence.path, "data/street");
  EXPECT_EQ(request.sequence.format, SequenceFormat::kAuto);
  EXPECT_FALSE(request.sequence.brightness.has_value());
  EXPECT_EQ(request.sequence.start, 0);
  EXPECT_LT(request.sequence.end, 0);
  EXPECT_FALSE(request.sequence.reverse);
  EXPECT_EQ(request.output, "out/street");
  EXPECT_EQ(request.speed, 0);
  EXPECT_TRUE(request.restart_when_lost);
  EXPECT_FALSE(request.write_result_txt);
  const Config config = loadConfig(request.config);
  EXPECT_EQ(config.initializer, "orb");
  EXPECT_EQ(config.options.num_threads, 0) << "all the machine has";
  EXPECT_FALSE(config.options.pipelined);
}

TEST(CommandLine, EveryFlagArrives) {
  const CommandLine request = parse({"seq",
                                     "--format=kitti",
                                     "--calib",
                                     "c.txt",
                                     "--gamma=g.txt",
                                     "--vignette",
                                     "v.png",
                                     "--initializer=orb-v1",
                                     "--preset",
                                     "default",
                                     "--set",
                                     "orb.min_frames=7",
                                     "--set=initializer.seed=3",
                                     "--mode",
                                     "perfect",
                                     "--start",
                                     "4",
                                     "--end=9",
                                     "--reverse",
                                     "--speed",
                                     "2.5",
                                     "--pipelined",
                                     "--threads",
                                     "1",
                                     "--on-lost",
                                     "stop",
                                     "--output",
                                     "o",
                                     "--quiet",
                                     "--progress=off"});
  EXPECT_EQ(request.sequence.format, SequenceFormat::kKitti);
  EXPECT_EQ(request.sequence.calibration_file, "c.txt");
  EXPECT_EQ(request.sequence.response_file, "g.txt");
  EXPECT_EQ(request.sequence.vignette_file, "v.png");
  EXPECT_EQ(request.sequence.brightness, BrightnessModel::kPerfect);
  EXPECT_EQ(request.sequence.start, 4);
  EXPECT_EQ(request.sequence.end, 9);
  EXPECT_TRUE(request.sequence.reverse);
  EXPECT_FALSE(request.restart_when_lost);
  EXPECT_EQ(request.speed, 2.5);
  EXPECT_EQ(request.output, "o");
  EXPECT_TRUE(request.quiet);
  EXPECT_EQ(request.progress, ProgressMode::kOff);
  const Config config = loadConfig(request.config);
  EXPECT_EQ(config.initializer, "orb-v1");
  EXPECT_EQ(config.options.num_threads, 1);
  EXPECT_TRUE(config.options.pipelined);
  EXPECT_EQ(config.options.initializer.orb.min_frames, 7);
  EXPECT_EQ(config.options.initializer.seed, 3);
}

TEST(CommandLine, DataSetMayStandAfterRepeatedOptions) {
  const CommandLine request = parse({"--config", "a.yaml", "--config", "b.yaml", "seq"});
  EXPECT_THAT(request.config.files, ElementsAre("a.yaml", "b.yaml"));
  EXPECT_EQ(request.sequence.path, "seq");
}

TEST(CommandLine, OutputIsNamedAfterTheDataSet) {
  EXPECT_EQ(parse({"/data/kitti/00/"}).output, "out/00");
  EXPECT_EQ(parse({"/data/seq/images.zip"}).output, "out/images");
}

TEST(CommandLine, UnknownOptionNamesTheClosest) {
  EXPECT_THAT(errorOf({"seq", "--initialiser=orb"}),
              AllOf(HasSubstr("'--initialiser=orb'"), HasSubstr("'--initializer'")));
  EXPECT_THAT(errorOf({"seq", "--theads", "2"}), HasSubstr("'--threads'"));
}

TEST(CommandLine, WrongValuesAreRefused) {
  for (const Arguments& arguments : std::vector<Arguments>{{"seq", "--start", "-1"},
                                                           {"seq", "--start", "two"},
                                                           {"seq", "--format", "ros"},
                                                           {"seq", "--mode", "0"},
                                                           {"seq", "--on-lost", "cry"},
                                                           {"seq", "--threads"},
                                                           {"seq", "--progress", "maybe"},
                                                           {"seq", "--speed", "-1"},
                                                           {"seq", "--speed", "nan"},
                                                           {"seq", "second"},
                                                           {"seq", "files=third"},
                                                           {}}) {
    EXPECT_NE(errorOf(arguments), "no ConfigError");
    EXPECT_EQ(errorOf(arguments).find('\n'), std::string::npos) << errorOf(arguments);
  }
}

TEST(CommandLine, WrongNumbersSayWhatIsExpected) {
  struct Case {
    Arguments arguments;
    const char* expected;
  };
  for (const Case& c :
       {Case{{"seq", "--start", "-1"}, "--start: '-1' must be a whole number, not negative"},
        Case{{"seq", "--start", "1.5"}, "'1.5' must be a whole number, not negative"},
        Case{{"seq", "--end=99999999999"}, "'99999999999' must be a whole number"},
        Case{{"seq", "--threads", "two"}, "--threads: 'two' must be a whole number"},
        Case{{"seq", "--speed", "1x"}, "'1x' must be a number in [0, 1000000]"},
        Case{{"start=1.5"}, "start=1.5: expected a whole number"},
        Case{{"speed=fast"}, "speed=fast: expected a number"}}) {
    EXPECT_THAT(errorOf(c.arguments), HasSubstr(c.expected));
  }
}

TEST(CommandLine, FlagsOfOnesOwnCameraArrive) {
  const CommandLine request = parse({"clip.mp4",
                                     "--hfov",
                                     "65.5",
                                     "--mask",
                                     "bonnet.png",
                                     "--width",
                                     "640",
                                     "--every",
                                     "2",
                                     "--from",
                                     "1.5",
                                     "--to",
                                     "30"});
  EXPECT_EQ(request.sequence.horizontal_view, 65.5);
  EXPECT_EQ(request.sequence.mask, "bonnet.png");
  EXPECT_EQ(request.sequence.width, 640);
  EXPECT_EQ(request.sequence.every, 2);
  EXPECT_EQ(request.sequence.from, 1.5);
  EXPECT_EQ(request.sequence.to, 30);
  EXPECT_EQ(parse({"/dev/video0", "--format", "camera"}).sequence.format, SequenceFormat::kCamera);
  EXPECT_EQ(parse({"/dev/video0"}).output, "out/video0");
  EXPECT_EQ(parse({"a/clip.mp4"}).output, "out/clip");
  EXPECT_EQ(parse({"a/clip.webm"}).output, "out/clip");
  EXPECT_DOUBLE_EQ(parse({"x", "--readout=-25"}).sequence.readout->seconds, -0.025);
  EXPECT_EQ(parse({"x", "--readout=-25"}).sequence.readout->sigma, 0);
  EXPECT_GT(parse({"x", "--readout", "auto"}).sequence.readout->sigma, 0);
  EXPECT_THAT(errorOf({"x", "--readout", "fast"}), HasSubstr("'fast' must be auto or a number in"));
  EXPECT_THAT(errorOf({"x", "--hfov", "180"}), HasSubstr("'180' must be a number in [1, 157]"));
  EXPECT_THAT(errorOf({"x", "--every", "0"}), HasSubstr("'0' must be a whole number from 1"));
  EXPECT_THAT(errorOf({"x", "--width=-5"}), HasSubstr("'-5' must be a whole number, not negative"));
  EXPECT_THAT(errorOf({"x", "--from=-1"}), HasSubstr("'-1' must be a number in [0, 1000000000]"));
  EXPECT_THAT(errorOf({"x", "--format", "camera", "--speed", "1"}), HasSubstr("time of its own"));
}

TEST(CommandLine, VersionAndHelpAreText) {
  EXPECT_THAT(parse({"--version"}).text, HasSubstr("dso_dataset "));
  const std::string help = parse({"--help"}).text;
  for (const char* flag :
       {"--format",    "--calib",  "--gamma",   "--vignette",     "--initializer",
        "--preset",    "--config", "--set",     "--print-config", "--mode",
        "--start",     "--end",    "--reverse", "--speed",        "--threads",
        "--on-lost",   "--output", "--quiet",   "--progress",     "--version",
        "--pipelined", "--hfov",   "--mask",    "--width",        "--every",
        "--from",      "--to"}) {
    EXPECT_THAT(help, HasSubstr(flag));
  }
}

TEST(LegacyArguments, HaveTheirMeaning) {
  const CommandLine request = parse({"files=seq/images",
                                     "calib=c.txt",
                                     "gamma=g.txt",
                                     "vignette=v.png",
                                     "preset=0",
                                     "mode=1",
                                     "start=3",
                                     "end=100000",
                                     "reverse=1",
                                     "quiet=1",
                                     "nomt=1",
                                     "speed=0"});
  EXPECT_EQ(request.sequence.path, "seq/images");
  EXPECT_EQ(request.sequence.calibration_file, "c.txt");
  EXPECT_EQ(request.sequence.response_file, "g.txt");
  EXPECT_EQ(request.sequence.vignette_file, "v.png");
  EXPECT_EQ(request.sequence.brightness, BrightnessModel::kUncalibrated);
  EXPECT_EQ(request.sequence.start, 3);
  EXPECT_EQ(request.sequence.end, 100000);
  EXPECT_TRUE(request.sequence.reverse);
  EXPECT_TRUE(request.quiet);
  EXPECT_TRUE(request.write_result_txt);
  EXPECT_EQ(optionsOf(request).num_threads, 1);
  EXPECT_THAT(request.warnings, IsEmpty());
}

TEST(LegacyArguments, SwitchesReactToOneOnly) {
  const CommandLine request = parse({"files=seq", "reverse=0", "quiet=2", "nomt=0"});
  EXPECT_FALSE(request.sequence.reverse);
  EXPECT_FALSE(request.quiet);
  EXPECT_EQ(optionsOf(request).num_threads, 0);
}

TEST(LegacyArguments, PresetsChooseSizeAndSpeed) {
  struct Case {
    const char* word;
    const char* preset;
    double speed;
  };
  for (const Case& c : {Case{"preset=0", "default", 0},
                        Case{"preset=1", "default", 1},
                        Case{"preset=2", "fast", 0},
                        Case{"preset=3", "fast", 5}}) {
    const CommandLine request = parse({"files=seq", c.word});
    EXPECT_EQ(request.config.preset, c.preset) << c.word;
    EXPECT_EQ(request.speed, c.speed) << c.word;
    EXPECT_EQ(optionsOf(request).pipelined, c.speed > 0) << c.word;
  }
}

TEST(LegacyArguments, ALaterSpeedOrPresetWins) {
  const CommandLine slower = parse({"files=seq", "preset=3", "speed=0.5"});
  EXPECT_EQ(slower.speed, 0.5);
  EXPECT_TRUE(optionsOf(slower).pipelined);
  const CommandLine all = parse({"files=seq", "preset=1", "speed=0"});
  EXPECT_EQ(all.speed, 0);
  EXPECT_FALSE(optionsOf(all).pipelined);
  EXPECT_EQ(parse({"files=seq", "speed=2", "preset=0"}).speed, 0);
  EXPECT_TRUE(optionsOf(parse({"files=seq", "speed=0", "--pipelined"})).pipelined);
}

TEST(LegacyArguments, WithoutMeaningGiveOneWarning) {
  const CommandLine request = parse({"files=seq", "nogui=1", "nolog=1", "rescale=0.5", "nogui=1"});
  EXPECT_THAT(request.warnings, ElementsAre(HasSubstr("nogui=1 nolog=1 rescale=0.5")));
}

TEST(LegacyArguments, UnknownAndMalformedOnesAreErrors) {
  EXPECT_THAT(errorOf({"files=seq", "calip=c.txt"}),
              AllOf(HasSubstr("unknown word 'calip=c.txt'"), HasSubstr("'calib='")));
  EXPECT_THAT(errorOf({"files=seq", "start=two"}), HasSubstr("start=two: expected a whole number"));
  EXPECT_THAT(errorOf({"files=seq", "mode=3"}), HasSubstr("must be 0, 1 or 2"));
  EXPECT_THAT(errorOf({"files=seq", "preset=4"}), HasSubstr("must be 0, 1, 2 or 3"));
  EXPECT_THAT(errorOf({"files=seq", "speed=-1"}), HasSubstr("not negative"));
}

TEST(LegacyArguments, PathWithAnEqualsSignIsStillADataSet) {
  EXPECT_EQ(parse({"./runs/speed=3/images"}).sequence.path, "./runs/speed=3/images");
}

}  // namespace
}  // namespace dsorb::app
