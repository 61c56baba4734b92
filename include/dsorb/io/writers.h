// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/calibration.h"
#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/odometry/observer.h"
#include "dsorb/odometry/odometry.h"
#include "dsorb/self_calibration/camera_finder.h"

#include <memory>
#include <string>
#include <vector>

namespace dsorb {

/// How a run ended; docs/formats.md.
enum class RunStatus {
  kTracked,           ///< to the end, and at least half of the images have a pose
  kPartlyTracked,     ///< to the end, but fewer have one
  kLost,              ///< the last image has no map
  kNeverInitialized,  ///< no image has a pose
  kInterrupted,       ///< the user ended it
  kError              ///< something failed
};

/// Name as in run.json, for example "never_initialized".
[[nodiscard]] const char* name(RunStatus status);

/// Facts about a run that the files contain although observers are not told them.
struct RunInfo {
  std::string program;      ///< name of the program that ran
  std::string version;      ///< version of that program
  std::string dataset;      ///< path as given
  std::string initializer;  ///< name of the variant
  int threads = 1;          ///< actually used, never 0
  std::string config_yaml;  ///< becomes config.yaml
};

/// Wall times of one frame.
struct FrameTiming {
  double work_milliseconds = 0;     ///< pyramid and odometry, without reading and undistorting
  double reading_milliseconds = 0;  ///< reading, decoding, undistorting
};

/// Writes the output folder of a run: trajectories, initializations, points, per-frame table,
/// summary and figures. As observer it only takes notes; files are written in frameDone() and
/// finish(), so that writing is not part of a frame's measured time. Whatever lies in the folder
/// after a crash is valid: text files grow by whole lines, points.ply by what its header counts,
/// all others are replaced by rename. Its memory grows by about 110 bytes a frame and 200 a
/// keyframe: 12 MB an hour at 30 frames a second.
class RunWriter : public OdometryObserver {
 public:
  /// Creates the folder and removes the files of an earlier run from it.
  /// @throws IoError where the folder cannot be created or written to
  RunWriter(const std::string& folder, const RunInfo& info);
  ~RunWriter() override;
  RunWriter(RunWriter&&) = delete;
  RunWriter& operator=(RunWriter&&) = delete;
  RunWriter(const RunWriter&) = delete;
  RunWriter& operator=(const RunWriter&) = delete;

  /// Camera of the rectified images; needed before the first frame.
  /// @param lens of the camera that took them; null: unknown
  void setCamera(const PinholeCamera& camera, const Lens* lens = nullptr);
  /// The camera that earlier passes over the images found.
  void setFoundCamera(const FoundCamera& camera);

  void onInitStep(const InitStep& step, const Frame& frame, int segment) override;
  void onFrame(const FrameEstimate& estimate) override;
  void onKeyframe(const KeyframeSnapshot& keyframe) override;
  void onKeyframeRetired(const KeyframeSnapshot& keyframe) override;
  void onStartRefused(const StartRefusal& refusal) override;
  void onSegmentsJoined(const SegmentsJoined& joined) override;
  void onLoopsClosed(const LoopsClosed& closed) override;
  void onTracks(const std::vector<MapTrack>& tracks) override;

  /// Writes what was noted since the last call. To be called after each Odometry::process.
  /// @param image_file of the frame; empty where its images are no files
  /// @throws IoError where a file cannot be written, for example on a full disk
  void frameDone(const FrameTiming& timing, const std::string& image_file = {});

  /// Counts images that were dropped because the run was late.
  void setDropped(int frames);

  /// Files of images that could not be read and were passed over.
  void setUnreadable(std::vector<std::string> files);

  /// Status up to now: tracked, lost (and not initialized again) or never initialized.
  [[nodiscard]] RunStatus outcome() const;
  /// Whether run.json has `calibration_suspected`: the first keyframes contradict the camera.
  [[nodiscard]] bool calibrationSuspected() const;

  /// Writes the final files.
  /// @param report of Odometry::finish(), or null when there is none after an error
  /// @throws IoError where a file cannot be written
  void finish(RunStatus status, const OdometryReport* report);

  /// Writes the trajectory of the keyframes, as in keyframes.txt, to another file.
  /// @throws IoError where it cannot be written
  void writeKeyframes(const std::string& path) const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace dsorb
