// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"

#include <array>
#include <vector>

namespace dsorb {

/// Distortion model of a lens, which maps the ray (x, y, 1). The comments list the coefficients in
/// the order of `Lens::coefficients`.
enum class LensModel {
  kPinhole,          ///< no distortion, no coefficients
  kFov,              ///< omega [rad]: field-of-view model
  kRadTan,           ///< k1 k2 p1 p2 k3: radial-tangential, the order of OpenCV
  kEquidistant,      ///< k1 k2 k3 k4: fisheye; EquiDistant and KannalaBrandt of calibration files
  kRational,         ///< k1 k2 p1 p2 k3 k4 k5 k6: rational polynomial, the order of OpenCV
  kDoubleSphere,     ///< xi alpha
  kExtendedUnified,  ///< alpha beta
  kUnified,          ///< xi k1 k2 p1 p2: a sphere and radial-tangential; omni of Kalibr, MEI
};

/// Time from the first to the last row [s]; 0: global shutter, below 0: the last row is first.
struct Readout {
  double seconds = 0;  ///< the time itself [s]
  double sigma = 0;    ///< standard deviation [s]; above 0 the odometry estimates the readout

  /// Whether rows have different times, or may have them.
  [[nodiscard]] bool isRolling() const { return seconds != 0 || sigma > 0; }
};

/// Readout of a camera of which nothing is known: its rows take at most the time between two
/// frames.
constexpr Readout kUnknownReadout{0, 0.02};

/// First coefficient of LensModel::kRadTan as an estimate [-].
struct RadialDistortion {
  double k1 = 0;     ///< seen = ideal (1 + k1 r^2) on the plane z = 1
  double sigma = 0;  ///< standard deviation
};

/// What images ask of a camera beside its calibration, by one linear step: a direction rather than
/// an amount.
struct CameraScore {
  double focal_change = 0;    ///< relative change of both focal lengths
  double focal_sigma = 0;     ///< standard deviation of that
  RadialDistortion radial{};  ///< change of the radial distortion, with its standard deviation

  /// Standard deviations by which it contradicts the calibration; 0 where it asks for less than 3 %
  /// of the focal length and .02 of the distortion, as a right camera may that is not modelled
  /// exactly.
  [[nodiscard]] double deviations() const;
  /// The part that contradicts it by more than four of them; what does not is 0.
  [[nodiscard]] CameraScore contradicting() const;
  /// Whether that is more than chance makes of a right calibration (a limit from measurements).
  [[nodiscard]] bool suspicious() const { return deviations() > 4; }
  /// Share by which a suspected camera gets motions wrong, 0 of one that is not: the change of its
  /// focal length, and how far the distortion moves pixels, as a share of their distance from the
  /// middle, in the root mean square over the image.
  [[nodiscard]] double motionError(const PinholeCamera& camera) const;
};

/// The camera that took the images. The centre of the top-left pixel is (0, 0).
struct Lens {
  LensModel model = LensModel::kPinhole;  ///< model of the distortion
  double fx = 0;                          ///< focal length [px]
  double fy = 0;                          ///< focal length [px]
  double cx = 0;                          ///< principal point [px]
  double cy = 0;                          ///< principal point [px]
  std::array<double, 8> coefficients{};   ///< of the model, as LensModel lists them; the rest are 0
  int width = 0;                          ///< [px]; 0: as the images are
  int height = 0;                         ///< [px]; 0: as the images are
  Readout readout{};                      ///< readout of rows, or of columns
  bool columns = false;                   ///< columns are read one after the other instead of rows
  bool backwards = false;  ///< the readout is from the image's last line to the first
  /// PinholeCamera::focal_sigma of the images rectified.
  double focal_sigma = 0;
};

/// What part of the distorted image the rectified one shows.
enum class RectificationMode {
  kCrop,      ///< largest rectangle without invalid pixels
  kFull,      ///< whole field of view, with invalid pixels
  kNone,      ///< no resampling, of a lens without distortion
  kExplicit,  ///< the camera given
};

/// The camera that images are rectified for. Its size is cropped on the right and at the bottom to
/// multiples of 16, so that the image pyramid gets enough levels.
struct Rectification {
  RectificationMode mode = RectificationMode::kCrop;  ///< where the camera comes from
  int width = 0;                                      ///< [px]; 0: as the input
  int height = 0;                                     ///< [px]; 0: as the input
  PinholeCamera camera;                               ///< for kExplicit; its size is not used
};

/// Photometric calibration. An empty vector says that the quantity is unknown.
struct PhotometricCalibration {
  std::vector<float>
      response;  ///< irradiance 0..255 by raw value, at least 256 entries, increasing
  std::vector<float> vignette;  ///< attenuation 0..1, row-major, size of the input image
  int vignette_width = 0;       ///< [px]
  int vignette_height = 0;      ///< [px]
};

/// Content of the calibration files of a data set.
struct Calibration {
  Lens lens;                           ///< lens of the camera that took the images
  Rectification rectification;         ///< what they are rectified for
  PhotometricCalibration photometric;  ///< response and vignette, where known
  /// The size is that of a part of the sensor, or of its pixels added up (roi and binning of ROS):
  /// images of another size are not a scaled version of it.
  bool cut = false;
};

/// Relative standard deviation of a focal length by a field of view that somebody states.
constexpr double kStatedFocalSigma = 0.15;

/// Lens of which nothing is known but the size of its images: PinholeCamera::unknown().
/// @throws std::invalid_argument without an image size
[[nodiscard]] Lens unknownLens(int width, int height);

/// Lens without distortion whose axis meets the middle of the image; a guess (kStatedFocalSigma).
/// @param degrees what an image sees from its left to its right edge
/// @throws std::invalid_argument outside 1 to 157 degrees, or without an image size
[[nodiscard]] Lens lensOfFieldOfView(double degrees, int width, int height);

/// The same camera where images are stored in another size: lens and output camera are scaled.
/// A lens without a size takes this one. Response and vignette stay as they are.
/// @throws std::invalid_argument where the sides would be scaled differently (by more than rounding
///         to whole pixels does), and of a calibration that is `cut`: it is not known then what was
///         cut off
[[nodiscard]] Calibration calibrationForSize(const Calibration& calibration, int width, int height);

/// The same camera where images are turned clockwise: principal point, tangential distortion,
/// readout, output camera and vignette turn with them.
/// @param degrees 0, 90, 180 or 270
[[nodiscard]] Calibration turned(const Calibration& calibration, int degrees);

/// The readout alone, of images that are turned clockwise.
/// @param degrees 0, 90, 180 or 270
void turnReadout(int degrees, Lens& lens);

/// The same calibration with smaller rectified images; the output's height follows.
/// @param width of the rectified images before they are cropped to multiples of 16 [px]
/// @throws std::invalid_argument where it is more than without, or so little that nothing is left
[[nodiscard]] Calibration withOutputWidth(const Calibration& calibration, int width);

}  // namespace dsorb
