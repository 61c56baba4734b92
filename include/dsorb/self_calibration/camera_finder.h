// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/calibration.h"
#include "dsorb/odometry/observer.h"

#include <cmath>
#include <memory>
#include <optional>
#include <string>

namespace dsorb {

/// The camera that took a recording, as its corners tell. Standard deviations are those of errors
/// that neighbouring corners share.
struct FoundCamera {
  /// Lens of the images as they were taken: a pinhole where no distortion shows, else kRadTan with
  /// k1, k2 and, where it shows, k3; its `readout` and `focal_sigma` have their standard
  /// deviations.
  Lens lens;
  double center_sigma = 0;        ///< of the principal point [px]
  double k1_sigma = 0;            ///< of the first radial coefficient
  int views = 0;                  ///< images that were adjusted
  int corners = 0;                ///< corners seen in them
  double error = 0;               ///< median distance between a corner and its prediction [px]
  double focal_change = 0;        ///< from the first image to the last, relative
  double focal_change_sigma = 0;  ///< 0: not known
  double shift = 0;               ///< of an image in its frame, beside one camera: rms [px]
  double shift_gain = 0;          ///< squared standard deviations that it explains, for each view

  /// Whether the focal length is known well enough to hold it.
  [[nodiscard]] bool isKnown() const { return lens.focal_sigma < 0.01; }
  /// Whether images move in their frame, as the crops of stabilized video do.
  [[nodiscard]] bool isStabilized() const { return shift_gain > 1; }
  /// Whether the focal length changes by more than chance explains: zoom, focus breathing.
  [[nodiscard]] bool changes() const {
    return focal_change_sigma > 0 && std::abs(focal_change) > 2 * focal_change_sigma;
  }
};

/// One line for people: "focal length 528 +- 3 px (62.4 degrees), distortion -.28 +- .01, readout
/// 24 +- 2 ms", and what is not known.
[[nodiscard]] std::string describe(const FoundCamera& camera);

/// Finds focal length, principal point, radial distortion and readout of the camera of a recording
/// while an odometry tracks it with a guess: follows corners through the images, and adjusts them
/// with the camera and the poses of the odometry, which need not be right.
/// @source Triggs et al., Bundle Adjustment - A Modern Synthesis, 1999
class CameraFinder : public OdometryObserver {
 public:
  /// @param guess     what is known beforehand: a focal length that is a guess (`focal_sigma`) is
  ///                  estimated with principal point and distortion, a readout with a `sigma` too
  /// @param images    the lens that images are rectified with, the guess or what was found with it
  /// @param rectified camera of the odometry's frames
  /// @param threads   0: all
  CameraFinder(const Lens& guess, const Lens& images, const PinholeCamera& rectified, int threads);
  ~CameraFinder() override;

  /// Takes the pose and follows the corners.
  void onFrame(const FrameEstimate& estimate) override;

  /// Images with a pose so far.
  [[nodiscard]] int frames() const;

  /// Adjusts what was seen so far. @return nothing where that is too little
  [[nodiscard]] std::optional<FoundCamera> find() const;

 private:
  class Impl;
  std::unique_ptr<Impl> impl_;
};

}  // namespace dsorb
