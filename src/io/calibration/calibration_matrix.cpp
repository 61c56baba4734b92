// SPDX-License-Identifier: BSD-3-Clause
#include "io/calibration/calibration_forms.h"
#include "io/calibration/camera_choice.h"
#include "io/calibration/lens_numbers.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <vector>

namespace dsorb {
namespace {

using io::KeyedValues;
using Keys = std::vector<const char*>;

/// Keys of the matrices of a camera.
struct MatrixKeys {
  Keys matrix;
  Keys distortion;
  std::vector<std::string> names;  // of the camera
};

const std::array<MatrixKeys, 3> kCameras = {{
    {{"camera_matrix", "cameraMatrix", "Camera_Matrix", "K", "k"},
     {"distortion_coefficients", "Distortion_Coefficients", "distCoeffs", "dist_coeffs", "D", "d"},
     {}},
    {{"M1", "K1", "cameraMatrix1", "camera_matrix_1"},
     {"D1", "distCoeffs1", "dist_coeffs_1"},
     {"M1", "cam0", "left", "1"}},
    {{"M2", "K2", "cameraMatrix2", "camera_matrix_2"},
     {"D2", "distCoeffs2", "dist_coeffs_2"},
     {"M2", "cam1", "right", "2"}},
}};

/// The first key that is there, or `data` below it; empty: none.
std::string findMatrix(const KeyedValues& values, const Keys& keys) {
  for (const char* key : keys) {
    if (values.has(key)) return key;
    if (values.has(std::string(key) + ".data")) return std::string(key) + ".data";
  }
  return {};
}

void readSize(const KeyedValues& values, Lens& lens) {
  const std::string width = values.find({"image_width", "image_Width", "width"});
  const std::string height = values.find({"image_height", "image_Height", "height"});
  if (width.empty() && height.empty()) return;
  if (width.empty() || height.empty()) {
    throw values.error("", "image_width and image_height are expected together");
  }
  setSize(values.number(width), values.number(height), lens, [&](const std::string& what) {
    return values.error(width, what);
  });
}

void readMatrix(const KeyedValues& values, const std::string& key, Lens& lens) {
  const std::vector<double> k = values.numbers(key, {9}, "the 9 of a 3x3 matrix");
  if (std::all_of(k.begin(), k.end(), [](double entry) { return entry == 0; })) {
    throw values.error(key, "is 0: nobody has calibrated this camera");
  }
  if (k[1] != 0 || k[3] != 0 || k[6] != 0 || k[7] != 0 || k[8] != 1) {
    throw values.error(key, "expected fx 0 cx, 0 fy cy, 0 0 1");
  }
  lens.fx = k[0];
  lens.cx = k[2];
  lens.fy = k[4];
  lens.cy = k[5];
}

LensModel readModel(const KeyedValues& values) {
  if (values.has("xi")) return LensModel::kUnified;  // cv::omnidir
  if (values.has("fisheye_model") && values.number("fisheye_model") != 0) {
    return LensModel::kEquidistant;
  }
  const std::string name =
      values.has("distortion_model") ? values.text("distortion_model", "a word") : "plumb_bob";
  if (name == "plumb_bob" || name == "rational_polynomial" || name == "radtan") {
    return LensModel::kRational;
  }
  if (name == "equidistant" || name == "fisheye") return LensModel::kEquidistant;
  if (name == "none" || name.empty()) return LensModel::kPinhole;
  throw values.error("distortion_model",
                     fmt::format("'{}'; expected plumb_bob, rational_polynomial, equidistant or "
                                 "none",
                                 quotable(name)));
}

void readCoefficients(const KeyedValues& values, const std::string& key, Lens& lens) {
  const auto complain = [&](const std::string& what) { return values.error(key, what); };
  const bool fisheye = lens.model == LensModel::kEquidistant;
  const std::string order = fisheye ? std::string("k1 k2 k3 k4 k5 k6 k7 k8") : kOpenCvOrder;
  setParameters(order, key.empty() ? std::vector<double>() : values.numbers(key), lens, complain);
  if (lens.model == LensModel::kUnified) lens.coefficients[0] = values.numbers("xi", {1}, "xi")[0];
}

/// A whole number of at least 0 that may be missing.
double countAt(const KeyedValues& values, const std::string& key) {
  if (!values.has(key)) return 0;
  const double number = values.number(key);
  if (number >= 0 && number <= kMaxSize && number == std::floor(number)) return number;
  throw values.error(key, "a whole number is expected, not negative");
}

/// K is that of the whole sensor: the region comes first, then its pixels are added up.
/// @source REP 104 of ROS
void cut(const KeyedValues& values, Calibration& calibration) {
  Lens& lens = calibration.lens;
  const double x = countAt(values, "roi.x_offset"), y = countAt(values, "roi.y_offset");
  const double width = countAt(values, "roi.width"), height = countAt(values, "roi.height");
  const double bin_x = std::max(1.0, countAt(values, "binning_x"));
  const double bin_y = std::max(1.0, countAt(values, "binning_y"));
  const double full_width = lens.width, full_height = lens.height;
  const double cut_width = width > 0 ? width : full_width - x;
  const double cut_height = height > 0 ? height : full_height - y;
  const bool whole = x == 0 && y == 0 && cut_width == full_width && cut_height == full_height;
  if (whole && bin_x == 1 && bin_y == 1) return;
  if (full_width == 0 || x + cut_width > full_width || y + cut_height > full_height) {
    throw values.error(values.has("roi.width") ? "roi.width" : "binning_x",
                       fmt::format("a region of {}x{} px at {} {} is no part of images of {}x{} px",
                                   cut_width,
                                   cut_height,
                                   x,
                                   y,
                                   full_width,
                                   full_height));
  }
  calibration.cut = true;
  lens.fx /= bin_x;
  lens.fy /= bin_y;
  lens.cx = (lens.cx - x + 0.5) / bin_x - 0.5;
  lens.cy = (lens.cy - y + 0.5) / bin_y - 0.5;
  setSize(std::floor(cut_width / bin_x),
          std::floor(cut_height / bin_y),
          lens,
          [&](const std::string& what) { return values.error("binning_x", what); });
}

/// @param matrix its key
Calibration readCamera(const KeyedValues& values,
                       const std::string& matrix,
                       const Keys& distortion) {
  Calibration calibration;
  Lens& lens = calibration.lens;
  readSize(values, lens);
  readMatrix(values, matrix, lens);
  lens.model = readModel(values);
  readCoefficients(values, findMatrix(values, distortion), lens);
  checkLens(lens, [&](const std::string& what) { return values.error(matrix, what); });
  cut(values, calibration);
  readReadoutKey(values, lens);
  simplify(calibration);
  return calibration;
}

}  // namespace

bool hasCameraMatrix(const KeyedValues& values) {
  return std::any_of(kCameras.begin(), kCameras.end(), [&](const MatrixKeys& keys) {
    return !findMatrix(values, keys.matrix).empty();
  });
}

Calibration readMatrices(const KeyedValues& values, const CameraChoice& choice) {
  std::vector<NamedCamera> cameras;
  for (const MatrixKeys& keys : kCameras) {
    const std::string matrix = findMatrix(values, keys.matrix);
    if (matrix.empty()) continue;
    cameras.push_back({keys.names, [&values, &keys, matrix] {
                         return readCamera(values, matrix, keys.distortion);
                       }});
    if (keys.names.empty()) break;
  }
  return readChosen(values.file(), cameras, choice);
}

}  // namespace dsorb
