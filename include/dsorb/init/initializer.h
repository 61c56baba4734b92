// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/init/result.h"
#include "dsorb/options/initializer.h"

#include <memory>
#include <optional>

namespace dsorb {

/// What a frame led to.
enum class InitStatus {
  kNeedsMoreFrames,  ///< earlier frames may be dropped where that loses nothing, not this one
  kRestarted,        ///< all earlier frames are dropped, this one is the new reference
  kInitialized       ///< `result` is set; the object is spent until reset()
};

/// What an initializer knows of the newest frame's motion while it waits to be surer.
struct WaitingMotion {
  FrameId reference;  ///< frame that the motion is relative to
  SE3 T_cam_ref;      ///< pose of the newest frame; the corners' mean inverse depth is 1
  std::optional<Matrix6d> covariance;  ///< of exp(xi) * T_cam_ref, [translation; rotation]
  double wrong_probability = 1;        ///< of the direction, as far as it was judged: GateReport
};

/// Answer to one frame.
struct InitStep {
  InitStatus status = InitStatus::kNeedsMoreFrames;  ///< after this frame
  InitReason reason = InitReason::kFirstFrame;       ///< why, for logs and tests
  std::optional<InitializationResult> result;        ///< set with kInitialized, and only then
  /// `orb` while it waits: this frame's motion, where an attempt with it came to the gate.
  std::optional<WaitingMotion> motion{};
};

/// Finds the first poses, inverse depths and brightness from frames given one by one. The contract
/// (docs/library.md) is tested by one suite for every kind.
class Initializer {
 public:
  virtual ~Initializer() = default;

  /// @param frame of the camera's size, in time order (either direction)
  /// @throws std::invalid_argument wrong size, timestamp equal to the previous one or a change of
  ///         direction
  /// @throws std::logic_error after a result, before reset()
  [[nodiscard]] virtual InitStep addFrame(FramePtr frame) = 0;

  /// Makes the object equal to a fresh one.
  virtual void reset() = 0;

  /// Tells whether, from the next frame on, other images wait behind it. `orb` then only follows
  /// its corners, which keeps up with a camera, and tries to start with a frame that leaves time
  /// for it, or after ten that do not. The other kinds ignore it. The caller sets it, not the
  /// frames: reset() leaves it.
  virtual void setHurried(bool /*hurried*/) {}
};

/// The initializer that the options name.
/// @throws ConfigError on options out of range and on the name of a registered kind that is not
///         there; IoError on a feature network that cannot be read;
///         std::invalid_argument on an impossible camera and on a size with too few pyramid levels
std::unique_ptr<Initializer> makeInitializer(const InitializerOptions& options,
                                             const PinholeCamera& camera);

}  // namespace dsorb
