// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/camera/calibration.h"

#include "base/angles.h"
#include "camera/image_size.h"
#include "camera/lens_models.h"

#include <algorithm>
#include <cmath>
#include <stdexcept>
#include <string>
#include <utility>

namespace dsorb {
namespace {

constexpr double kMinView = 1;                                            // [degrees]
const double kMaxView = std::floor(2 * std::atan(kMaxRay) * kDegPerRad);  // [degrees]

/// @tparam Camera with members fx, fy, cx, cy
template <typename Camera>
void scale(double sx, double sy, Camera& camera) {
  camera.fx *= sx;
  camera.fy *= sy;
  camera.cx = (camera.cx + 0.5) * sx - 0.5;
  camera.cy = (camera.cy + 0.5) * sy - 0.5;
}

int scaled(int size, double factor) {
  return static_cast<int>(std::lround(size * factor));
}

/// Turns the camera of an image whose height was `height` clockwise by 90 degrees.
/// @tparam Camera with members fx, fy, cx, cy
template <typename Camera>
void turnByQuarter(int height, Camera& camera) {
  std::swap(camera.fx, camera.fy);
  const double cx = camera.cx;
  camera.cx = height - 1 - camera.cy;
  camera.cy = cx;
}

void turnByQuarter(Lens& lens) {
  turnByQuarter(lens.height, lens);
  if (const std::size_t place = tangentialPlace(lens.model)) {  // x and y become y and -x
    std::swap(lens.coefficients[place], lens.coefficients[place + 1]);
    lens.coefficients[place + 1] *= -1;
  }
  std::swap(lens.width, lens.height);
  turnReadout(90, lens);
}

void turnByQuarter(PhotometricCalibration& photometric) {
  const int width = photometric.vignette_width;
  const int height = photometric.vignette_height;
  const std::vector<float> upright = photometric.vignette;
  auto pixel = photometric.vignette.begin();
  for (int x = 0; x < width; ++x) {
    for (int y = height - 1; y >= 0; --y) {
      *pixel++ = upright[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                         static_cast<std::size_t>(x)];
    }
  }
  std::swap(photometric.vignette_width, photometric.vignette_height);
}

}  // namespace

double CameraScore::deviations() const {
  constexpr double kLeastFocal = 0.03;
  constexpr double kLeastRadial = 0.02;
  const auto contradiction = [](double change, double sigma, double least) {
    const bool large = std::abs(change) > least && sigma > 0;
    return large ? std::abs(change) / sigma : 0.0;
  };
  return std::max(contradiction(focal_change, focal_sigma, kLeastFocal),
                  contradiction(radial.k1, radial.sigma, kLeastRadial));
}

CameraScore CameraScore::contradicting() const {
  const CameraScore focal{focal_change, focal_sigma, {}};
  const CameraScore distortion{0, 0, radial};
  CameraScore parts;
  if (focal.suspicious()) parts = focal;
  if (distortion.suspicious()) parts.radial = radial;
  return parts;
}

double CameraScore::motionError(const PinholeCamera& camera) const {
  const CameraScore wrong = contradicting();
  const double x2 = std::pow(0.5 * camera.width / camera.fx, 2);
  const double y2 = std::pow(0.5 * camera.height / camera.fy, 2);
  const double mean_r4 = (x2 * x2 + y2 * y2) / 5 + 2 * x2 * y2 / 9;  // over the image
  return std::hypot(wrong.focal_change, wrong.radial.k1 * std::sqrt(mean_r4));
}

Lens lensOfFieldOfView(double degrees, int width, int height) {
  if (!(degrees >= kMinView && degrees <= kMaxView)) {
    throw std::invalid_argument("a field of view of " + std::to_string(degrees) +
                                " degrees: expected 1 to " + std::to_string(std::lround(kMaxView)));
  }
  if (width <= 0 || height <= 0) throw std::invalid_argument("an image size is expected");
  Lens lens;
  lens.fx = lens.fy = 0.5 * width / std::tan(0.5 * degrees * kRadPerDeg);
  lens.cx = 0.5 * (width - 1);
  lens.cy = 0.5 * (height - 1);
  lens.width = width;
  lens.height = height;
  lens.focal_sigma = kStatedFocalSigma;
  return lens;
}

Lens unknownLens(int width, int height) {
  if (width <= 0 || height <= 0) throw std::invalid_argument("an image size is expected");
  const PinholeCamera camera = PinholeCamera::unknown(width, height);
  Lens lens{LensModel::kPinhole, camera.fx, camera.fy, camera.cx, camera.cy, {}, width, height};
  lens.focal_sigma = camera.focal_sigma;
  return lens;
}

Calibration calibrationForSize(const Calibration& calibration, int width, int height) {
  Calibration result = calibration;
  Lens& lens = result.lens;
  if (lens.width == 0 || lens.height == 0) {
    lens.width = width;
    lens.height = height;
  }
  if (lens.width == width && lens.height == height) return result;
  if (calibration.cut) {
    throw std::invalid_argument("by its roi and binning the calibration is for images of " +
                                sizeText(lens.width, lens.height) + " px, these have " +
                                sizeText(width, height));
  }
  const double sx = static_cast<double>(width) / lens.width;
  const double sy = static_cast<double>(height) / lens.height;
  // Rounding a side to whole pixels moves it by half a pixel at most.
  const double rounding = 0.5 / std::min({width, height, lens.width, lens.height});
  if (std::abs(sx - sy) > 2 * rounding * std::max(sx, sy)) {
    throw std::invalid_argument("the calibration is for images of " +
                                sizeText(lens.width, lens.height) + " px, these have " +
                                sizeText(width, height) +
                                ": not the same shape, so it is not known what was cut off");
  }
  scale(sx, sy, lens);
  Rectification& output = result.rectification;
  if (output.mode == RectificationMode::kExplicit) scale(sx, sy, output.camera);
  output.width = output.width == lens.width ? width : scaled(output.width, sx);
  output.height = output.height == lens.height ? height : scaled(output.height, sy);
  lens.width = width;
  lens.height = height;
  return result;
}

void turnReadout(int degrees, Lens& lens) {
  for (int turn = 0; turn < degrees; turn += 90) {
    if (!lens.columns) lens.backwards = !lens.backwards;  // the first row is on the right
    lens.columns = !lens.columns;
  }
}

Calibration turned(const Calibration& calibration, int degrees) {
  Calibration result = calibration;
  Rectification& output = result.rectification;
  for (int turn = 0; turn < degrees; turn += 90) {
    const int output_height = output.height > 0 ? output.height : result.lens.height;
    turnByQuarter(output_height, output.camera);
    std::swap(output.width, output.height);
    turnByQuarter(result.lens);
    turnByQuarter(result.photometric);
  }
  return result;
}

Calibration withOutputWidth(const Calibration& calibration, int width) {
  Calibration result = calibration;
  Rectification& output = result.rectification;
  const int full_width = output.width > 0 ? output.width : calibration.lens.width;
  const int full_height = output.height > 0 ? output.height : calibration.lens.height;
  if (width > full_width || width < 16) {
    throw std::invalid_argument("an output width of " + std::to_string(width) +
                                " px: expected 16 to " + std::to_string(full_width));
  }
  output.width = width;
  output.height = scaled(full_height, static_cast<double>(width) / full_width);
  if (output.mode == RectificationMode::kNone && width != full_width) {
    output.mode = RectificationMode::kExplicit;
    const Lens& lens = result.lens;
    output.camera = {lens.fx, lens.fy, lens.cx, lens.cy, 0, 0};
  }
  if (output.mode == RectificationMode::kExplicit) {
    const double factor = static_cast<double>(width) / full_width;
    scale(factor, factor, output.camera);
  }
  return result;
}

}  // namespace dsorb
