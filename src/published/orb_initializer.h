// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/init/initializer.h"

#include "base/parallel.h"
#include "image/frame_check.h"
#include "init/reset_log.h"
#include "published/features.h"
#include "published/structure.h"

#include <memory>

namespace dsorb::published {

/// The thesis' three versions, and the variant of X. Qu that its section 4 describes.
enum class Version {
  kV1,       ///< geometry only
  kV2,       ///< photometric adjustment of everything
  kV3,       ///< outlier filter and second photometric adjustment
  kMatching  ///< kV1 with descriptors between two frames, and the model with the most inliers
};

/// The initializer of [Gladkova], algorithm 1: names and order of its steps are those of the print.
/// docs/variants.md says where it differs, and why.
/// @source docs/references.md has the full reference
class ORBInitializer final : public Initializer {
 public:
  ORBInitializer(Version version, const InitializerOptions& options, const PinholeCamera& camera);

  [[nodiscard]] InitStep addFrame(FramePtr frame) override;
  void reset() override;

 private:
  InitStep trackFrame(FramePtr frame);
  InitReason initialize();
  InitReason computeRelativeTransform();
  /// @return whether the map is usable afterwards, as of the next one
  bool performGeometricBA();
  bool performPhotometricBAs();

  /// Makes the frame the reference. @return the step
  InitStep resetRefFrame(FramePtr frame, InitStep step);
  /// Answer to a frame with which the attempt failed.
  InitStep failure(FramePtr frame, InitReason reason);
  [[nodiscard]] bool onlyRotated() const;

  Version version_;
  InitializerOptions options_;
  PinholeCamera camera_;
  TaskArena arena_;
  FrameCheck frame_check_;
  Features features_;
  Map map_;            // of the attempt with the newest frame
  InitReport report_;  // of the same
  StageClock clock_;
  ResetLog resets_;
  int age_ = 0;    // frames since the reference, it included
  int blank_ = 0;  // frames in a row that show nothing
  bool spent_ = false;
};

}  // namespace dsorb::published
