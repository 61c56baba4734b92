// SPDX-License-Identifier: BSD-3-Clause
// wrong_starts INITIALIZER SEQUENCE FIRST [SEED]: initializes from the image FIRST on, makes the
// start wrong in several ways and prints what the first adjustment of the window makes of each:
//   start  refused (reason or "stays")  direction_deg  depth_spread  depth_change  kept_share
#include "support/wrong_starts.h"

#include "dsorb/io/sequence_reader.h"

#include "odometry/mapper.h"

#include <fmt/core.h>

#include <cstdio>
#include <cstdlib>
#include <exception>
#include <optional>
#include <string>

namespace dsorb {
namespace {

std::optional<InitializationResult> startOf(SequenceReader& reader,
                                            const InitializerOptions& options) {
  const auto initializer = makeInitializer(options, reader.camera());
  while (const std::optional<SequenceFrame> next = reader.next()) {
    InitStep step = initializer->addFrame(next->frame);
    if (step.result) return std::move(step.result);
  }
  return std::nullopt;
}

void judge(const std::string& name,
           const InitializationResult& start,
           const PinholeCamera& camera,
           const OdometryOptions& options) {
  odometry::Mapper mapper(camera, options);
  const odometry::MapUpdate update = mapper.seed(start, 0);
  const StartChange& change = update.start_change;
  const std::optional<RefusalReason> reason =
      update.finite ? refusalOf(change) : std::optional(RefusalReason::kAdjustment);
  fmt::print("{} {} {:.3f} {:.4f} {:.3f} {:.3f}\n",
             name,
             reason ? dsorb::name(*reason) : "stays",
             change.direction_deg,
             change.depth_spread,
             change.depth_change,
             change.kept_share);
}

int run(int argc, char** argv) {
  if (argc < 4) {
    fmt::print(stderr, "usage: wrong_starts INITIALIZER SEQUENCE FIRST [SEED]\n");
    return 2;
  }
  SequenceOptions sequence;
  sequence.path = argv[2];
  sequence.start = std::atoi(argv[3]);
  OdometryOptions options;
  options.initializer = initializerVariant(argv[1]);
  if (argc > 4) options.initializer.seed = std::atoi(argv[4]);
  SequenceReader reader(sequence);
  options.brightness = reader.brightness();
  const std::optional<InitializationResult> start = startOf(reader, options.initializer);
  if (!start) {
    fmt::print("never_initialized\n");
    return 3;
  }
  for (const auto& [name, wrong] : withWrongOnes(*start)) {
    judge(name, wrong, reader.camera(), options);
  }
  return 0;
}

}  // namespace
}  // namespace dsorb

int main(int argc, char** argv) {
  try {
    return dsorb::run(argc, argv);
  } catch (const std::exception& error) {
    std::fprintf(stderr, "%s\n", error.what());
    return 1;
  }
}
