// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/calibration.h"
#include "dsorb/io/writers.h"
#include "dsorb/odometry/observer.h"
#include "dsorb/self_calibration/camera_finder.h"

#include "io/output/output_file.h"
#include "io/output/run_record.h"
#include "self_calibration/refined_camera.h"

#include <optional>
#include <string>
#include <vector>

namespace dsorb::io {

/// Calibration file of images as they were taken, as DSO's camera.txt.
/// @param lens a pinhole or kRadTan
[[nodiscard]] std::string calibrationFile(const Lens& lens);

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
  RefinedCamera refined;                ///< by the window
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
