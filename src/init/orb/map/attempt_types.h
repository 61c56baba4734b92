// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/calibration.h"
#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/image/frame.h"
#include "dsorb/init/report.h"
#include "dsorb/options/initializer.h"

#include "features/corner_tracks.h"
#include "init/orb/map/initial_map.h"
#include "init/reset_log.h"

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

/// Judgement of a start from the essential matrix: how likely it is that the newest frame's
/// direction of translation is off by more than GateOptions::wrong_angle_deg, and why.
struct GateReport {
  InitReason reason = InitReason::kDone;  ///< kDone when it passed
  double wrong_probability = 1;           ///< both causes together
  double error_probability = 1;           ///< first: tails of the direction's distribution
  double plane_probability = 0;           ///< second: the other motion that a plane allows
  double direction_sigma_deg = 0;         ///< larger axis of the direction's covariance, x 1.5
  double second_sigma_deg = 0;            ///< smaller axis, x 1.5: scale of its t-distribution
  double lost_factor = 1;   ///< of these sigmas and of depth_sigma, for tracks that were lost
  double misfit = 1;        ///< errors of the corners over what noise of the images explains
  double depth_sigma = 0;   ///< predicted relative error of a corner's inverse depth, median
  double parallax_deg = 0;  ///< median angle under which both cameras see a corner
};

/// What became of depths that the caller knows of the reference.
struct DepthPriorReport {
  bool used = false;          ///< the start is made of them; otherwise it is one without
  bool contradicted = false;  ///< the images contradict them: they give no scale, either
  int corners = 0;            ///< that have a depth
  double inflation = 1;       ///< factor on the claimed standard deviations, to fit the images [-]
};

/// Summary of the latest attempt from a reference, which tells when the next one is worth its time.
struct AttemptSummary {
  InitReason reason = InitReason::kSettling;  ///< why it did not succeed
  double rotation_residual = 0;               ///< median rotation-compensated flow [px]
  std::optional<GateReport> gate;             ///< judgement, where it came so far
  int skipped = 0;                            ///< frames since then
  bool tried = false;                         ///< with this frame: it took its time
};

/// Tracks that a start could have been made of.
struct LiveTracks {
  int count = 0;
  bool matched = false;  ///< by descriptors, some of them
};

/// Matches of a reference while most of its corners lived: those that have been lost since, too.
struct EarlyMatches {
  FrameId frame;  ///< the last one with half of the corners, or the first after the reference
  Matches matches;
};

/// Input of an attempt: frames and tracks since one reference.
struct ReferenceView {
  std::vector<FramePtr> frames;      ///< the reference first
  CornerTracks tracks;               ///< one entry a frame
  AttemptSummary last;               ///< the attempt before
  EarlyMatches early;                ///< as the images show them
  bool matched = false;              ///< descriptors, for some of the tracks
  std::optional<Readout> readout{};  ///< that the tracks were moved to the middle rows with
};

/// Value that passes through the stages of an attempt: the map and the report so far.
struct Reconstruction {
  InitialMap map;
  InitReport report;
  LiveTracks live{};                              ///< of the reference
  GeometricOptions adjustment{};                  ///< that fits the map's observations
  std::optional<DepthPriorReport> depth_prior{};  ///< where the caller knows depths
};

/// Context of every stage of an attempt.
struct AttemptContext {
  const PinholeCamera& camera;
  const InitializerOptions& options;
  StageClock& clock;

  [[nodiscard]] std::uint64_t seed() const { return static_cast<std::uint64_t>(options.seed); }
};

}  // namespace dsorb::init_orb
