// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/frame_priors.h"
#include "dsorb/init/initializer.h"
#include "dsorb/odometry/observer.h"
#include "dsorb/options/odometry.h"

#include <functional>
#include <memory>
#include <optional>
#include <vector>

namespace dsorb {

/// Where a frame was taken in a map of before: a segment that was told, or one that somebody keeps.
struct RecognizedPlace {
  int segment = 0;                     ///< goes on where the camera is found in it
  SE3 T_world_cam;                     ///< in the segment's world, as told
  std::vector<DepthAtPixel> depths;    ///< of the frame, in the segment's unit as told
  std::optional<FrameId> keyframe;     ///< that it was recognized by, where this run has told it
  std::optional<SE3> T_cam_keyframe;   ///< pose relative to that keyframe
  std::optional<Matrix6d> covariance;  ///< of exp(xi) * T_cam_world, [translation; rotation]
};
/// Answers where a frame was taken; nothing where it is not sure. Place::recognizer().
using Recognizer = std::function<std::optional<RecognizedPlace>(const Frame&)>;

/// Seconds spent in each stage and counts, over the whole run.
struct OdometryReport {
  int frames_given = 0;             ///< frames given to process()
  int frames_tracked = 0;           ///< without those of initializations
  int frames_missed = 0;            ///< without a pose while a map stood
  int keyframes = 0;                ///< those of initializations included
  int segments = 0;                 ///< segments with a successful initialization
  int recognized = 0;               ///< starts that went on in a segment of before
  double initializing_seconds = 0;  ///< [s]
  double tracking_seconds = 0;      ///< [s]
  double mapping_seconds = 0;       ///< [s]; pipelined it runs beside tracking
};

/// Direct visual odometry, one frame at a time: initializing, tracking, lost. Sequential and
/// deterministic: the same frames and options give the same bits for any number of threads. With
/// OdometryOptions::pipelined it returns as soon as the frame is tracked; mapping goes on in a
/// thread of its own. Either way one thread at a time may call it, and only the calls of that
/// thread tell observers. Where InitializationResult::metric is there, all of the segment is told
/// in metres (estimates and keyframes, not the result itself), else in the start's own unit.
class Odometry {
 public:
  /// Makes the initializer that the options name. @throws ConfigError on options out of range
  Odometry(const PinholeCamera& camera, const OdometryOptions& options);
  /// Takes an initializer of the caller's. Both throw std::invalid_argument on an impossible camera
  /// and on a size that leaves too few pyramid levels.
  Odometry(const PinholeCamera& camera,
           const OdometryOptions& options,
           std::unique_ptr<Initializer> initializer);
  ~Odometry();
  Odometry(Odometry&&) noexcept;             ///< the other may only be destroyed or assigned to
  Odometry& operator=(Odometry&&) noexcept;  ///< the other may only be destroyed or assigned to

  /// @param observer must outlive this object; called in the order of registration
  void addObserver(OdometryObserver* observer);

  /// While there is no map, every frame is asked about, and with one those that it does not show:
  /// where a frame is recognized, it becomes the reference of a start from known depths, and what
  /// follows is told in the world and unit of the segment of before, which goes on. Frames that the
  /// map does not show have the pose that they are recognized at until then. Without a recognizer
  /// nothing is asked.
  /// @param first_segment number of the first one that begins anew; below it are those that the
  ///        recognizer knows beforehand
  void setRecognizer(Recognizer recognizer, int first_segment = 0);

  /// Takes the next frame and tells observers.
  /// @param hurried other images wait behind it already: Initializer::setHurried. The same frames
  ///        give the same bits only with the same answers.
  /// @throws std::invalid_argument a frame out of place, std::logic_error when lost; also what
  ///         mapping threw, pipelined that of an earlier frame: then the map is lost, its keyframes
  ///         retire with restart() or finish()
  FrameEstimate process(const FramePtr& frame, bool hurried = false);

  /// Leaves the state lost: the next frame starts a new segment with a new initialization; its time
  /// may be any, and begins a new direction.
  void restart();

  /// Retires what is left and reports; further frames throw std::logic_error.
  OdometryReport finish();

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace dsorb
