// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/calibration.h"
#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/image/frame.h"
#include "dsorb/init/report.h"
#include "dsorb/options/initializer.h"

#include "features/corner_tracks.h"
#include "init/orb/map/initial_map.h"
#include "init/stage_clock.h"

#include <cstdint>
#include <optional>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

namespace dsorb::init_orb {

/// Result of a stage, or the reason why there is none.
template <typename T>
class Outcome {
 public:
  Outcome(T&& made) : state_(std::move(made)) {}  // implicit: a stage returns what it made,
  Outcome(InitReason reason) : state_(reason) {}  // or its reason

  explicit operator bool() const { return state_.index() == 0; }
  [[nodiscard]] InitReason reason() const {
    return *this ? InitReason::kDone : std::get<1>(state_);
  }
  T& operator*() { return std::get<0>(state_); }
  T* operator->() { return &std::get<0>(state_); }

  /// Passes the result to the next stage; without a result the reason is passed on.
  template <typename Stage>
  std::invoke_result_t<Stage, T> then(Stage&& stage) && {
    if (!*this) return reason();
    return std::forward<Stage>(stage)(std::move(**this));
  }

 private:
  std::variant<T, InitReason> state_;
};

/// Summary of the latest attempt from a reference, which tells when the next one is worth its time.
struct AttemptSummary {
  InitReason reason = InitReason::kSettling;  ///< why it did not succeed
  double rotation_residual = 0;               ///< median rotation-compensated flow [px]
  std::optional<GateReport> gate;             ///< judgement, where it came so far
  int skipped = 0;                            ///< frames since then
  bool tried = false;                         ///< with this frame: it took its time
};

/// Input of an attempt: frames and tracks since one reference.
struct ReferenceView {
  std::vector<FramePtr> frames;      ///< the reference first
  CornerTracks tracks;               ///< one entry a frame
  AttemptSummary last;               ///< the attempt before
  std::optional<Readout> readout{};  ///< that the tracks were moved to the middle rows with
};

/// Value that passes through the stages of an attempt: the map and the report so far.
struct Reconstruction {
  InitialMap map;
  InitReport report;
};

/// Context of every stage of an attempt.
struct AttemptContext {
  const PinholeCamera& camera;
  const InitializerOptions& options;
  StageClock& clock;

  [[nodiscard]] std::uint64_t seed() const { return static_cast<std::uint64_t>(options.seed); }
};

}  // namespace dsorb::init_orb
