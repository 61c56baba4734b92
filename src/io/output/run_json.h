// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/calibration.h"
#include "dsorb/io/writers.h"
#include "dsorb/odometry/observer.h"
#include "dsorb/self_calibration/camera_finder.h"

#include "io/output/output_file.h"
#include "io/output/run_record.h"

#include <array>
#include <optional>
#include <set>
#include <string>
#include <vector>

namespace dsorb::io {

/// Calibration file of images as they were taken, as DSO's camera.txt.
/// @param lens a pinhole or kRadTan
[[nodiscard]] std::string calibrationFile(const Lens& lens);

/// The camera that the window refines, over a run: the estimate of the segment that knows the focal
/// length best.
class CameraEstimate {
 public:
  /// Takes the camera of the newest keyframe, a few doubles of it.
  void add(const KeyframeSnapshot& keyframe);

  [[nodiscard]] const std::optional<PinholeCamera>& camera() const { return known_.camera; }
  /// Whether the focal length is known to 1 %: by two sigmas, and by how much it still moved.
  [[nodiscard]] bool isSettled() const;
  /// The object in run.json: the camera and, where the window estimates it, how sure that is.
  /// @param with_sigma of a camera that is not null
  [[nodiscard]] Json json() const;

  /// Calibration file of the images as they were taken, as DSO's camera.txt.
  /// @param lens      that was taken for that of the images, without distortion
  /// @param rectified the camera that the odometry began with
  /// @return empty where the estimate is not known or the lens had a distortion
  [[nodiscard]] std::string calibrationFile(const Lens& lens, const PinholeCamera& rectified) const;

 private:
  struct Estimate {
    std::optional<PinholeCamera> camera;
    std::optional<std::array<double, 4>> sigmas;  // fx, fy, cx, cy [px]
    std::optional<RadialDistortion> radial;
    double moved = 0;  // in the last third of its segment, relative
    int segment = -1;
  };
  [[nodiscard]] bool isDistorted() const;
  [[nodiscard]] static double focalSigma(const Estimate& estimate);
  [[nodiscard]] double movement() const;

  Estimate known_;
  int segment_ = -1;
  std::set<FrameId> frames_;           // keyframes of the segment
  std::vector<double> focal_lengths_;  // one a keyframe
};

/// Time that the stages of a run took [s].
struct RunSeconds {
  double total = 0;
  double reading = 0;
  double initializing = 0;
  double tracking = 0;
  double mapping = 0;
  double writing = 0;  ///< files of the output folder but the last run.json
};

/// Outcome of a run as far as its record does not contain it.
struct RunEnd {
  RunStatus status = RunStatus::kError;
  int frames_dropped = 0;
  std::vector<std::string> unreadable;  ///< files that were passed over
  RunSeconds seconds;
};

[[nodiscard]] Json cameraJson(const PinholeCamera& camera);

[[nodiscard]] Json lensJson(const Lens& lens);

/// The cameras of a run as far as they are known.
struct RunCameras {
  std::optional<PinholeCamera> camera;  ///< of the rectified images
  std::optional<Lens> lens;             ///< of the images as they were taken
  CameraEstimate refined;               ///< by the window
  std::optional<FoundCamera> found;     ///< by earlier passes, as `lens`
  std::optional<Readout> readout;       ///< estimated, of the newest keyframe

  /// Whether `refined` may be the next run's calibration. The window holds principal point,
  /// distortion and readout as they were found: where the images did not tell the focal length
  /// beside these, its own standard deviation is too small.
  [[nodiscard]] bool areSettled() const {
    return refined.isSettled() && (!found || found->isKnown());
  }
};

/// Content of run.json.
[[nodiscard]] Json runJson(const RunInfo& info,
                           const RunCameras& cameras,
                           const RunRecord& record,
                           const RunEnd& end);

}  // namespace dsorb::io
