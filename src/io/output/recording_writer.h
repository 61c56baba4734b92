// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/io/writers.h"
#include "dsorb/odometry/observer.h"

#include "io/output/output_file.h"

#include <filesystem>
#include <functional>
#include <vector>

namespace dsorb::io {

/// @throws IoError where a recording would take the place of a file that is none
void refuseOthers(const std::filesystem::path& path);

/// Writes a recording (docs/formats.md): one JSON object a line, readable while the run goes on,
/// and the rectified images in a folder beside it. As observer it only takes notes; lines and
/// images are written in frameDone(), outside of what a frame's time counts.
class RecordingWriter : public OdometryObserver {
 public:
  /// Starts the recording with its header. Images go to `<stem>_images` beside the file.
  /// @throws IoError where file or folder cannot be created
  RecordingWriter(const std::filesystem::path& path,
                  const RunInfo& info,
                  const PinholeCamera& camera);

  void onInitStep(const InitStep& step, const Frame& frame, int segment) override;
  void onStartRefused(const StartRefusal& refusal) override;
  void onFrame(const FrameEstimate& estimate) override;
  void onKeyframe(const KeyframeSnapshot& keyframe) override { noteKeyframe(keyframe, false); }
  void onKeyframeRetired(const KeyframeSnapshot& keyframe) override {
    noteKeyframe(keyframe, true);
  }
  void onLost(FrameId frame, int segment) override;

  /// Writes the frame's image and all lines noted since the last call.
  /// @param estimate what Odometry::process returned for the frame
  /// @throws IoError where something cannot be written
  void frameDone(const FrameEstimate& estimate);
  /// Writes the remaining lines and the last one.
  void finish(RunStatus status);

 private:
  void noteKeyframe(const KeyframeSnapshot& keyframe, bool final);
  void writePending();
  void writeLine(const Json& line);

  GrowingFile file_;
  std::filesystem::path folder_;                ///< of the recording
  std::filesystem::path images_;                ///< relative to it
  std::vector<std::function<Json()>> pending_;  ///< lines of the current frame, formatted later
};

}  // namespace dsorb::io
