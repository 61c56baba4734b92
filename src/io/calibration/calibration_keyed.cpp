// SPDX-License-Identifier: BSD-3-Clause
#include "io/calibration/lens_numbers.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

namespace dsorb {
namespace {

using io::KeyedValues;
using Strings = std::vector<std::string>;
using LensWords = std::vector<LensWord>;

constexpr int kMaxCameras = 100;    // of one file
constexpr double kHalfPixel = 0.5;  // where pixels have their centres at .5

/// Whether all numbers of a list are 0, or there is none.
bool isZero(const std::vector<double>& numbers) {
  return std::all_of(numbers.begin(), numbers.end(), [](double n) { return n == 0; });
}

/// Reads one of a list of cameras that are called cam0, cam1 and so on, and perhaps by a name of
/// their own.
/// @param paths of the cameras by their numbers
/// @param name  key of a camera's own name
template <typename Paths, typename Read>
Calibration readOneOf(const KeyedValues& values,
                      const CameraChoice& choice,
                      const Paths& paths,
                      const std::string& name,
                      const Read& read) {
  std::vector<NamedCamera> cameras;
  for (int i = 0; i < kMaxCameras; ++i) {
    const std::string path = paths(i);
    if (!values.hasPath(path)) continue;
    const KeyedValues camera = values.within(path);
    if (camera.empty()) throw values.error(path, "a mapping that describes a camera is expected");
    NamedCamera named{{fmt::format("cam{}", i)}, [camera, &read, i] { return read(camera, i); }};
    if (camera.has(name)) named.names.push_back(camera.text(name, "a name"));
    cameras.push_back(std::move(named));
  }
  return readChosen(values.file(), cameras, choice);
}

// ROS' camera_info (camera_matrix or K, distortion_coefficients or D, distortion_model, binning,
// roi), or what cv::FileStorage wrote. A matrix is a list, or a group with `data`.

/// Keys of the matrices of a camera.
struct MatrixKeys {
  Strings matrix;
  Strings distortion;
  Strings names;  // of the camera
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
std::string findMatrix(const KeyedValues& values, const Strings& keys) {
  Strings all;
  for (const std::string& key : keys) all.insert(all.end(), {key, key + ".data"});
  return values.find(all);
}

void readMatrix(const KeyedValues& values, const std::string& key, Lens& lens) {
  const std::vector<double> k = values.numbers(key, 9, "the 9 of a 3x3 matrix");
  if (isZero(k)) throw values.error(key, "is 0: nobody has calibrated this camera");
  if (k[1] != 0 || k[3] != 0 || k[6] != 0 || k[7] != 0 || k[8] != 1) {
    throw values.error(key, "expected fx 0 cx, 0 fy cy, 0 0 1");
  }
  setParameters("fx fy cx cy", {k[0], k[4], k[2], k[5]}, lens, values.complain(key));
}

/// OpenCV's lens is the rational one, whatever it is called; the numbers that it lacks are 0.
constexpr std::string_view kOpenCv = "[k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tau_x tau_y]";
const LensWords kRosModels = {{"plumb_bob", LensModel::kRational, kOpenCv},
                              {"rational_polynomial", LensModel::kRational, kOpenCv},
                              {"radtan", LensModel::kRational, kOpenCv},
                              {"equidistant", LensModel::kEquidistant, "[k1 k2 k3 k4 k5 k6 k7 k8]"},
                              {"fisheye", LensModel::kEquidistant, "[k1 k2 k3 k4 k5 k6 k7 k8]"},
                              {"none", LensModel::kPinhole, kOpenCv}};

void readDistortion(const KeyedValues& values, const std::string& key, Lens& lens) {
  const std::string model_key = "distortion_model";
  const bool fisheye = values.has("fisheye_model") && values.number("fisheye_model") != 0;
  std::string word = fisheye ? "fisheye" : "plumb_bob";
  if (!fisheye && values.has(model_key)) word = values.text(model_key, "a word");
  if (word.empty()) word = "none";
  const bool omnidir = values.has("xi");  // of OpenCV
  const LensWord& model =
      omnidir ? kRosModels.front() : findLens(kRosModels, word, values.complain(model_key));
  lens.model = omnidir ? LensModel::kUnified : model.model;
  setParameters(model.parameters, values.numbers(key), lens, values.complain(key));
  if (omnidir) lens.coefficients[0] = values.numbers("xi", 1, "xi")[0];
}

/// A whole number of at least 0 that may be missing.
double countAt(const KeyedValues& values, const std::string& key) {
  const double number = values.has(key) ? values.number(key) : 0;
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
  const double cut_width = width > 0 ? width : lens.width - x;
  const double cut_height = height > 0 ? height : lens.height - y;
  const bool whole = x == 0 && y == 0 && cut_width == lens.width && cut_height == lens.height;
  if (whole && bin_x == 1 && bin_y == 1) return;
  if (lens.width == 0 || x + cut_width > lens.width || y + cut_height > lens.height) {
    throw values.error(values.has("roi.width") ? "roi.width" : "binning_x",
                       fmt::format("a region of {} at {} {} is no part of images of {}",
                                   pixelText(cut_width, cut_height),
                                   x,
                                   y,
                                   pixelText(lens.width, lens.height)));
  }
  calibration.cut = true;
  lens.fx /= bin_x;
  lens.fy /= bin_y;
  lens.cx = (lens.cx - x + kHalfPixel) / bin_x - kHalfPixel;
  lens.cy = (lens.cy - y + kHalfPixel) / bin_y - kHalfPixel;
  setSize(std::floor(cut_width / bin_x),
          std::floor(cut_height / bin_y),
          lens,
          values.complain("binning_x"));
}

Calibration readMatrices(const KeyedValues& values, const CameraChoice& choice) {
  std::vector<NamedCamera> cameras;
  for (const MatrixKeys& keys : kCameras) {
    const std::string matrix = findMatrix(values, keys.matrix);
    if (matrix.empty()) continue;
    cameras.push_back({keys.names, [&values, &keys, matrix] {
                         Lens lens;
                         readSize(values, lens);
                         readMatrix(values, matrix, lens);
                         readDistortion(values, findMatrix(values, keys.distortion), lens);
                         Calibration calibration = finished(values, matrix, lens);
                         cut(values, calibration);
                         return calibration;
                       }});
    if (keys.names.empty()) break;
  }
  return readChosen(values.file(), cameras, choice);
}

// EuRoC's sensor.yaml or Kalibr's camchain.yaml.

/// Words for projection and distortion, with the order of the coefficients.
/// @source Kalibr's wiki, "Supported models"; EuRoC has longer names
const LensWords kKalibrModels = {
    {"pinhole radtan", LensModel::kRadTan, "k1 k2 p1 p2 [k3]"},
    {"pinhole radial-tangential", LensModel::kRadTan, "k1 k2 p1 p2 [k3]"},
    {"pinhole plumb_bob", LensModel::kRadTan, "k1 k2 p1 p2 [k3]"},
    {"pinhole equidistant", LensModel::kEquidistant, "k1 k2 k3 k4"},
    {"pinhole fov", LensModel::kFov, "omega"},
    {"pinhole none", LensModel::kPinhole, ""},
    {"omni radtan", LensModel::kUnified, "k1 k2 p1 p2"},
    {"omni radial-tangential", LensModel::kUnified, "k1 k2 p1 p2"},
    {"omni none", LensModel::kUnified, ""},
    {"ds none", LensModel::kDoubleSphere, ""},
    {"eucm none", LensModel::kExtendedUnified, ""}};

/// Numbers of Kalibr's projections.
const LensWords kKalibrProjections = {
    {"pinhole", LensModel::kPinhole, "fx fy cx cy"},
    {"omni", LensModel::kUnified, "xi fx fy cx cy"},
    {"ds", LensModel::kDoubleSphere, "xi alpha fx fy cx cy"},
    {"eucm", LensModel::kExtendedUnified, "alpha beta fx fy cx cy"}};

Calibration readKalibrCamera(const KeyedValues& values) {
  const std::string camera = values.text("camera_model", "pinhole, omni, ds or eucm");
  const LensWord& projection =
      findLens(kKalibrProjections, camera, values.complain("camera_model"));
  const std::string distortion = values.text("distortion_model", "the model of the distortion");
  const LensWord& model =
      findLens(kKalibrModels, camera + " " + distortion, values.complain("distortion_model"));
  Lens lens;
  lens.model = model.model;
  setParameters(
      projection.parameters, values.numbers("intrinsics"), lens, values.complain("intrinsics"));
  readSize(values, "resolution", lens);
  const char* key =
      values.has("distortion_coeffs") ? "distortion_coeffs" : "distortion_coefficients";
  if (!model.parameters.empty()) {
    setParameters(model.parameters, values.numbers(key), lens, values.complain(key));
  } else if (!isZero(values.numbers(key))) {
    throw values.error(key, "numbers, but distortion_model is none");
  }
  return finished(values, "intrinsics", lens);
}

std::string kalibrPath(int number) {
  return fmt::format("cam{}", number);
}

/// Whether it is a chain of cameras; a sensor.yaml is one camera.
bool isChain(const KeyedValues& values) {
  for (int i = 0; i < kMaxCameras; ++i) {
    if (values.hasPath(kalibrPath(i))) return true;
  }
  return false;
}

Calibration readKalibr(const KeyedValues& values, const CameraChoice& choice) {
  if (!isChain(values)) return readKalibrCamera(values);
  return readOneOf(values, choice, kalibrPath, "rostopic", [](const KeyedValues& camera, int) {
    return readKalibrCamera(camera);
  });
}

// Settings of ORB-SLAM2 and 3, and of stella_vslam, which nests the same keys.

constexpr std::string_view kPinholeNumbers = "fx fy cx cy [k1 k2 p1 p2 k3 k4 k5 k6]";
constexpr std::string_view kFisheyeNumbers = "fx fy cx cy [k1 k2 k3 k4]";
const LensWords kOrbModels = {{"PinHole", LensModel::kRadTan, kPinholeNumbers},
                              {"perspective", LensModel::kRadTan, kPinholeNumbers},
                              {"Rectified", LensModel::kPinhole, "fx fy cx cy"},
                              {"KannalaBrandt8", LensModel::kEquidistant, kFisheyeNumbers},
                              {"fisheye", LensModel::kEquidistant, kFisheyeNumbers}};

/// @param group of the camera, Camera or Camera1 or Camera2
Calibration readOrb(const KeyedValues& values, const std::string& group) {
  for (const char* stereo : {"LEFT.K", "StereoRectifier"}) {
    if (!values.hasPath(stereo)) continue;
    throw values.error(stereo,
                       "the numbers of Camera are those of images that this program rectifies for "
                       "two cameras; write camera.txt with those of the left or right one");
  }
  const KeyedValues camera = values.within("Camera");
  const std::string key = camera.find({"type", "model"});
  const LensWord& model =
      key.empty() ? kOrbModels.front()
                  : findLens(kOrbModels, camera.text(key, "a lens model"), camera.complain(key));
  Lens lens;
  lens.model = model.model;
  readSize(camera, lens);
  readParameters(values.within(group), model.parameters, lens);
  return finished(values, group + ".fx", lens);
}

Calibration readOrbs(const KeyedValues& values, const CameraChoice& choice) {
  std::vector<NamedCamera> cameras;
  const auto add = [&](const char* group, Strings names) {
    cameras.push_back({std::move(names), [&values, group] { return readOrb(values, group); }});
  };
  const bool several = values.hasPath("Camera2");
  const char* first = values.hasPath("Camera1") ? "Camera1" : "Camera";
  const bool nameless = !several && !values.hasPath("Camera1");
  add(first, nameless ? Strings{} : Strings{first, "cam0", "left"});
  if (several) add("Camera2", {"Camera2", "cam1", "right"});
  return readChosen(values.file(), cameras, choice);
}

// VINS: a file a camera.

const LensWords kVinsModels = {
    {"PINHOLE", LensModel::kRadTan, kPinholeNumbers},
    {"PINHOLE_FULL", LensModel::kRational, "fx fy cx cy [k1 k2 k3 k4 k5 k6 p1 p2]"},
    {"KANNALA_BRANDT",
     LensModel::kEquidistant,
     "mu=fx mv=fy u0=cx v0=cy [k2=k1 k3=k2 k4=k3 k5=k4]"},
    {"MEI", LensModel::kUnified, "gamma1=fx gamma2=fy u0=cx v0=cy [xi k1 k2 p1 p2]"}};
/// Groups that parameters may stand in.
const Strings kVinsGroups = {
    "projection_parameters.", "distortion_parameters.", "mirror_parameters."};

Calibration readVins(const KeyedValues& values) {
  const std::string key = "model_type";
  const LensWord& model =
      findLens(kVinsModels, values.text(key, "a lens model"), values.complain(key));
  Lens lens;
  lens.model = model.model;
  readSize(values, lens);
  const std::string first = readParameters(values, model.parameters, lens, kVinsGroups);
  if (values.has("rolling_shutter") && values.number("rolling_shutter") != 0) {
    lens.readout.seconds = values.number("rolling_shutter_tr");
  }
  return finished(values, first, lens);
}

// SVO and aslam: a list of cameras.

const LensWords kSvoModels = {{"none", LensModel::kPinhole, ""},
                              {"radial-tangential", LensModel::kRadTan, "[k1 k2 p1 p2 k3]"},
                              {"equidistant", LensModel::kEquidistant, "[k1 k2 k3 k4]"},
                              {"fisheye", LensModel::kFov, "[omega]"}};

Calibration readSvo(const KeyedValues& camera, int /*number*/) {
  const auto model = [&](const LensWords& models, const std::string& key) {
    return findLens(models, camera.text(key, "a lens model"), camera.complain(key));
  };
  (void)model({{"pinhole", LensModel::kPinhole, ""}}, "type");
  const LensWord distortion = model(kSvoModels, "distortion.type");
  const char* intrinsics = camera.has("intrinsics") ? "intrinsics" : "intrinsics.data";
  const std::string key = camera.find({"distortion.parameters", "distortion.parameters.data"});
  Lens lens;
  lens.model = distortion.model;
  readSize(camera, lens);
  setParameters("fx fy cx cy", camera.numbers(intrinsics), lens, camera.complain(intrinsics));
  if (lens.model != LensModel::kPinhole) {  // for which SVO writes four zeros
    setParameters(distortion.parameters, camera.numbers(key), lens, camera.complain(key));
  }
  if (camera.has("line-delay-nanoseconds") && lens.height > 0) {
    lens.readout.seconds = 1e-9 * camera.number("line-delay-nanoseconds") * (lens.height - 1);
  }
  return finished(camera, intrinsics, lens);
}

std::string svoPath(int number) {
  return fmt::format("cameras[{}].camera", number);
}

// Basalt.

const LensWords kBasaltModels = {{"pinhole", LensModel::kPinhole, "fx fy cx cy"},
                                 {"pinhole-radtan8", LensModel::kRational, kPinholeNumbers},
                                 {"kb4", LensModel::kEquidistant, kFisheyeNumbers},
                                 {"fov", LensModel::kFov, "fx fy cx cy [w=omega]"},
                                 {"ucm", LensModel::kExtendedUnified, "fx fy cx cy [alpha]"},
                                 {"eucm", LensModel::kExtendedUnified, "fx fy cx cy [alpha beta]"},
                                 {"ds", LensModel::kDoubleSphere, "fx fy cx cy [xi alpha]"}};

std::string basaltPath(int number) {
  return fmt::format("value0.intrinsics[{}]", number);
}

/// @param values of the whole file
Calibration readBasalt(const KeyedValues& values, const KeyedValues& camera, int number) {
  const std::string key = "camera_type";
  const LensWord& model =
      findLens(kBasaltModels, camera.text(key, "a lens model"), camera.complain(key));
  Lens lens;
  lens.model = model.model;
  lens.coefficients[1] = model.word == "ucm" ? 1 : 0;  // beta
  readSize(values, fmt::format("value0.resolution[{}]", number), lens);
  readParameters(camera.within("intrinsics"), model.parameters, lens);
  return finished(values, basaltPath(number) + ".intrinsics.fx", lens);
}

// transforms.json of nerfstudio and instant-ngp.

constexpr std::string_view kNerfNumbers = "[k1 k2 k3 k4 p1 p2]";
const LensWords kNerfModels = {{"OPENCV", LensModel::kRadTan, kNerfNumbers},
                               {"PINHOLE", LensModel::kPinhole, kNerfNumbers},
                               {"SIMPLE_PINHOLE", LensModel::kPinhole, kNerfNumbers},
                               {"OPENCV_FISHEYE", LensModel::kEquidistant, kNerfNumbers}};

/// Frames may have a lens each, which must be that of the first one.
void checkFrames(const KeyedValues& values) {
  const KeyedValues first = values.within("frames[0]");
  const std::string keys = "camera_model fl_x fl_y cx cy w h k1 k2 k3 k4 p1 p2";
  for (int i = 0; values.hasPath(fmt::format("frames[{}]", i)); ++i) {
    const KeyedValues frame = values.within(fmt::format("frames[{}]", i));
    for (const std::string& key : splitWords(keys)) {
      const KeyedValues& all = values.has(key) ? values : first;
      if (!frame.has(key) || (all.has(key) && all.text(key, "") == frame.text(key, ""))) continue;
      throw frame.error(key, "another lens than that of other frames; expected one for all");
    }
  }
}

/// Focal lengths and principal point; instant-ngp may have the field of view [rad] in their place.
void readNerfProjection(const KeyedValues& camera, Lens& lens) {
  const auto size = [&](const char* key, int pixels) {
    if (pixels == 0) throw camera.error(key, "is missing; a number of pixels is expected");
    return static_cast<double>(pixels);
  };
  const auto focal = [](double pixels, double angle) { return 0.5 * pixels / std::tan(angle / 2); };
  const bool by_angle = !camera.has("fl_x") && camera.has("camera_angle_x");
  lens.fx = by_angle ? focal(size("w", lens.width), camera.number("camera_angle_x"))
                     : camera.number("fl_x");
  lens.fy = lens.fx;
  if (by_angle && camera.has("camera_angle_y")) {
    lens.fy = focal(size("h", lens.height), camera.number("camera_angle_y"));
  }
  if (camera.has("fl_y")) lens.fy = camera.number("fl_y");
  lens.cx = (camera.has("cx") ? camera.number("cx") : size("w", lens.width) / 2) - kHalfPixel;
  lens.cy = (camera.has("cy") ? camera.number("cy") : size("h", lens.height) / 2) - kHalfPixel;
}

Calibration readNerf(const KeyedValues& values) {
  checkFrames(values);
  for (const char* key : {"rolling_shutter", "distortion_params"}) {
    if (isZero(values.numbers(key))) continue;
    throw values.error(key, "is not read here; expected none, or only zeros");
  }
  const bool of_frames = values.has("frames[0].fl_x") && !values.has("fl_x");
  const KeyedValues camera = of_frames ? values.within("frames[0]") : values;
  const std::string key = "camera_model";
  const KeyedValues& named = camera.has(key) ? camera : values;
  const bool fisheye = values.has("is_fisheye") && values.text("is_fisheye", "") == "true";
  Lens lens;
  lens.model = named.has(key)
                   ? findLens(kNerfModels, named.text(key, ""), named.complain(key)).model
               : fisheye ? LensModel::kEquidistant
                         : LensModel::kRadTan;
  readSize(camera, lens);
  readNerfProjection(camera, lens);
  readParameters(camera, kNerfNumbers, lens);
  return finished(values, of_frames ? "frames[0].fl_x" : "fl_x", lens);
}

}  // namespace

Calibration readKeyed(const KeyedValues& values, const CameraChoice& choice) {
  const bool matrices = std::any_of(kCameras.begin(), kCameras.end(), [&](const MatrixKeys& keys) {
    return !findMatrix(values, keys.matrix).empty();
  });
  if (matrices) return readMatrices(values, choice);
  const bool frames = values.hasPath("frames[0]");
  if (values.has("fl_x") || values.has("camera_angle_x") || frames) return readNerf(values);
  if (values.has("camera_model") || isChain(values)) return readKalibr(values, choice);
  if (values.hasPath("Camera") || values.hasPath("Camera1")) return readOrbs(values, choice);
  if (values.has("model_type")) return readVins(values);
  if (values.hasPath(svoPath(0))) return readOneOf(values, choice, svoPath, "label", readSvo);
  if (values.hasPath(basaltPath(0))) {
    return readOneOf(values, choice, basaltPath, "", [&](const KeyedValues& camera, int i) {
      return readBasalt(values, camera, i);
    });
  }
  if (values.has("cam0_calib")) {
    throw values.error("cam0_calib",
                       "the lens stands in the file that this names; give that one with --calib");
  }
  throw values.error("",
                     "no calibration that is known here: expected camera_matrix (ROS, OpenCV), "
                     "camera_model (EuRoC, Kalibr), Camera.fx (ORB-SLAM), model_type (VINS) or "
                     "another form of docs/calibration.md");
}

}  // namespace dsorb
