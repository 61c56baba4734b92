// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/initializer.h"

#include "base/parallel.h"
#include "init/orb/feature_tracks.h"
#include "init/orb/initial_map.h"
#include "init/orb/matches.h"
#include "init/stage_clock.h"

#include <optional>
#include <vector>

namespace dsorb::init_orb {

/// Initializer from corner tracks: two-view geometry between the reference and the newest frame,
/// geometric adjustment of all frames between, semi-dense inverse depth of the reference.
/// @source Gladkova, Feature-based Initialization for Monocular Direct Visual Odometry, algorithm 1
class ORBInitializer final : public Initializer {
 public:
  ORBInitializer(const InitializerOptions& options, const PinholeCamera& camera);

  [[nodiscard]] InitStep addFrame(FramePtr frame) override;
  void reset() override;

 private:
  /// What is known of one try to initialize; `map` is set when it succeeded.
  struct Attempt {
    InitReason reason = InitReason::kSettling;
    std::optional<InitialMap> map;
    InitReport report;
  };

  void checkFrame(const Frame& frame) const;
  InitStep advance(FramePtr frame);
  [[nodiscard]] bool onlyRotated() const;
  /// Median that a rotation leaves of the displacements, as an angle.
  [[nodiscard]] double rotationResidualDeg(const Matches& matches) const;
  Attempt attempt();
  void buildMap(const Matches& matches, Attempt& attempt);
  InitStep finish(Attempt attempt);

  void takeReference(FramePtr frame);
  InitStep waitWithNewReference(FramePtr frame, InitReason reason);
  InitStep restart(FramePtr frame, InitReason reason);

  InitializerOptions options_;
  PinholeCamera camera_;
  TaskArena arena_;
  FeatureTracks tracks_;
  std::vector<FramePtr> frames_;  // since the reference, which is first
  StageClock clock_;
  int restarts_ = 0;
  std::vector<InitReason> earlier_resets_;  // the latest ones
  std::vector<double> last_timestamps_;     // of the newest frames, at most two
  bool spent_ = false;
};

}  // namespace dsorb::init_orb
