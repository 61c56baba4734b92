// SPDX-License-Identifier: BSD-3-Clause
#include "camera/lens_models.h"
#include "io/calibration/calibration_forms.h"
#include "io/calibration/camera_choice.h"
#include "io/calibration/lens_numbers.h"

#include <fmt/format.h>
#include <strings.h>

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

constexpr double kHalfPixel = 0.5;  // where pixels have their centres at .5

/// A lens model as a program calls it, with the keys of its parameters: "key=parameter", or one
/// word for both. Parameters beside the first four may be missing.
struct SettingsModel {
  const char* word;  // in large or small letters
  LensModel model;
  const char* parameters;
};

using SettingsModels = std::vector<SettingsModel>;
using Strings = std::vector<std::string>;

const SettingsModel& modelOf(const KeyedValues& values,
                             const std::string& key,
                             const SettingsModels& models) {
  std::string known;
  for (const SettingsModel& model : models) known += fmt::format(", {}", model.word);
  const std::string word = values.text(key, "a lens model");
  const auto model = std::find_if(models.begin(), models.end(), [&](const SettingsModel& m) {
    return strcasecmp(m.word, word.c_str()) == 0;
  });
  if (model != models.end()) return *model;
  throw values.error(
      key,
      fmt::format("'{}' is no lens model that is known here; expected {}. Where the lens can be "
                  "calibrated with one of docs/calibration.md, write that as camera.txt",
                  quotable(word),
                  known.substr(2)));
}

/// @param groups that a key may stand in, each with the dot behind it
void readParameters(const KeyedValues& values,
                    const SettingsModel& model,
                    Lens& lens,
                    const Strings& groups = {""}) {
  lens.model = model.model;
  int place = 0;
  std::string first;
  for (const std::string& pair : splitWords(model.parameters)) {
    const std::string own = pair.substr(0, pair.find('='));
    const auto group = std::find_if(
        groups.begin(), groups.end(), [&](const std::string& g) { return values.has(g + own); });
    const std::string key = (group == groups.end() ? groups.front() : *group) + own;
    const auto complain = [&](const std::string& what) { return values.error(key, what); };
    if (place++ < 4 && !values.has(key)) throw complain("is missing; a number is expected");
    if (place == 1) first = key;
    if (!values.has(key)) continue;
    setParameter(pair.substr(pair.find('=') + 1), values.number(key), lens, complain);
  }
  checkLens(lens, [&](const std::string& what) { return values.error(first, what); });
}

/// The size by two keys, where they are there.
void readSize(const KeyedValues& values, const char* width, const char* height, Lens& lens) {
  if (!values.has(width) && !values.has(height)) return;
  setSize(values.number(width), values.number(height), lens, [&](const std::string& what) {
    return values.error(width, what);
  });
}

Calibration finished(const KeyedValues& values, Calibration calibration) {
  readReadoutKey(values, calibration.lens);
  simplify(calibration);
  return calibration;
}

/// ORB-SLAM2 and 3, and stella_vslam, which nests the same keys.
const SettingsModels kOrbModels = {
    {"PinHole", LensModel::kRadTan, "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"},
    {"perspective", LensModel::kRadTan, "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"},
    {"Rectified", LensModel::kPinhole, "fx fy cx cy"},
    {"KannalaBrandt8", LensModel::kEquidistant, "fx fy cx cy k1 k2 k3 k4"},
    {"fisheye", LensModel::kEquidistant, "fx fy cx cy k1 k2 k3 k4"}};

/// @param group of the camera, Camera or Camera1 or Camera2
Calibration readOrb(const KeyedValues& values, const std::string& group) {
  for (const char* stereo : {"LEFT.K", "StereoRectifier"}) {
    if (!values.hasPath(stereo)) continue;
    throw values.error(stereo,
                       "the numbers of Camera are those of images that this program rectifies for "
                       "two cameras; write camera.txt with those of the left or right one");
  }
  const KeyedValues camera = values.within("Camera");
  const KeyedValues own = values.within(group);
  const std::string key = camera.find({"type", "model"});
  Calibration calibration;
  Lens& lens = calibration.lens;
  readSize(
      camera, camera.has("cols") ? "cols" : "width", camera.has("rows") ? "rows" : "height", lens);
  readParameters(own, key.empty() ? kOrbModels.front() : modelOf(camera, key, kOrbModels), lens);
  return finished(values, calibration);
}

Calibration readOrbs(const KeyedValues& values, const CameraChoice& choice) {
  std::vector<NamedCamera> cameras;
  const auto add = [&](const char* group, std::vector<std::string> names) {
    cameras.push_back({std::move(names), [&values, group] { return readOrb(values, group); }});
  };
  const bool several = values.hasPath("Camera2");
  if (values.hasPath("Camera1")) {
    add("Camera1", {"Camera1", "cam0", "left"});
  } else {
    add("Camera",
        several ? std::vector<std::string>{"Camera", "cam0", "left"} : std::vector<std::string>{});
  }
  if (several) add("Camera2", {"Camera2", "cam1", "right"});
  return readChosen(values.file(), cameras, choice);
}

const SettingsModels kVinsModels = {
    {"PINHOLE", LensModel::kRadTan, "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"},
    {"PINHOLE_FULL", LensModel::kRational, "fx fy cx cy k1 k2 k3 k4 k5 k6 p1 p2"},
    {"KANNALA_BRANDT", LensModel::kEquidistant, "mu=fx mv=fy u0=cx v0=cy k2=k1 k3=k2 k4=k3 k5=k4"},
    {"MEI", LensModel::kUnified, "gamma1=fx gamma2=fy u0=cx v0=cy xi k1 k2 p1 p2"}};
/// Groups that parameters may stand in.
const Strings kVinsGroups = {
    "projection_parameters.", "distortion_parameters.", "mirror_parameters."};

Calibration readVins(const KeyedValues& values) {
  Calibration calibration;
  Lens& lens = calibration.lens;
  readSize(values, "image_width", "image_height", lens);
  readParameters(values, modelOf(values, "model_type", kVinsModels), lens, kVinsGroups);
  if (values.has("rolling_shutter") && values.number("rolling_shutter") != 0) {
    lens.readout.seconds = values.number("rolling_shutter_tr");
  }
  return finished(values, calibration);
}

/// SVO and aslam: a list of cameras.
const SettingsModels kSvoModels = {{"none", LensModel::kPinhole, ""},
                                   {"radial-tangential", LensModel::kRadTan, "k1 k2 p1 p2 k3"},
                                   {"equidistant", LensModel::kEquidistant, "k1 k2 k3 k4"},
                                   {"fisheye", LensModel::kFov, "omega"}};

Calibration readSvo(const KeyedValues& camera) {
  const SettingsModels pinhole = {{"pinhole", LensModel::kPinhole, ""}};
  (void)modelOf(camera, "type", pinhole);
  const auto complain = [&](const char* key) {
    return [&camera, key](const std::string& what) { return camera.error(key, what); };
  };
  Calibration calibration;
  Lens& lens = calibration.lens;
  const SettingsModel& model = modelOf(camera, "distortion.type", kSvoModels);
  lens.model = model.model;
  readSize(camera, "image_width", "image_height", lens);
  const auto intrinsics = camera.numbers(
      camera.has("intrinsics") ? "intrinsics" : "intrinsics.data", {4}, "fx fy cx cy");
  setParameters("fx fy cx cy", intrinsics, lens, complain("intrinsics.data"));
  const char* key =
      camera.has("distortion.parameters") ? "distortion.parameters" : "distortion.parameters.data";
  std::vector<double> coefficients = camera.numbers(key);
  if (lens.model == LensModel::kPinhole) coefficients.clear();  // SVO writes four zeros
  setParameters(model.parameters, coefficients, lens, complain(key));
  checkLens(lens, complain("intrinsics.data"));
  if (camera.has("line-delay-nanoseconds") && lens.height > 0) {
    lens.readout.seconds = 1e-9 * camera.number("line-delay-nanoseconds") * (lens.height - 1);
  }
  return finished(camera, calibration);
}

Calibration readSvos(const KeyedValues& values, const CameraChoice& choice) {
  std::vector<NamedCamera> cameras;
  for (int i = 0;; ++i) {
    const KeyedValues camera = values.within(fmt::format("cameras[{}].camera", i));
    if (camera.empty()) break;
    NamedCamera named{{fmt::format("cam{}", i)}, [camera] { return readSvo(camera); }};
    if (camera.has("label")) named.names.push_back(camera.text("label", "a name"));
    cameras.push_back(std::move(named));
  }
  return readChosen(values.file(), cameras, choice);
}

const SettingsModels kBasaltModels = {
    {"pinhole", LensModel::kPinhole, "fx fy cx cy"},
    {"pinhole-radtan8", LensModel::kRational, "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"},
    {"kb4", LensModel::kEquidistant, "fx fy cx cy k1 k2 k3 k4"},
    {"fov", LensModel::kFov, "fx fy cx cy w=omega"},
    {"ucm", LensModel::kExtendedUnified, "fx fy cx cy alpha"},
    {"eucm", LensModel::kExtendedUnified, "fx fy cx cy alpha beta"},
    {"ds", LensModel::kDoubleSphere, "fx fy cx cy xi alpha"}};

Calibration readBasalt(const KeyedValues& values, int number) {
  const KeyedValues camera = values.within(fmt::format("value0.intrinsics[{}]", number));
  const std::string resolution = fmt::format("value0.resolution[{}]", number);
  Calibration calibration;
  Lens& lens = calibration.lens;
  const auto size = values.numbers(resolution, {2}, "width, height");
  setSize(size[0], size[1], lens, [&](const std::string& what) {
    return values.error(resolution, what);
  });
  const SettingsModel& model = modelOf(camera, "camera_type", kBasaltModels);
  lens.coefficients[1] = model.word == std::string_view("ucm") ? 1 : 0;  // beta
  readParameters(camera.within("intrinsics"), model, lens);
  return finished(values, calibration);
}

Calibration readBasalts(const KeyedValues& values, const CameraChoice& choice) {
  std::vector<NamedCamera> cameras;
  for (int i = 0; values.hasPath(fmt::format("value0.intrinsics[{}]", i)); ++i) {
    cameras.push_back({{fmt::format("cam{}", i)}, [&values, i] { return readBasalt(values, i); }});
  }
  return readChosen(values.file(), cameras, choice);
}

/// Models of nerfstudio, all of whose coefficients have names of their own.
const SettingsModels kNerfModels = {{"OPENCV", LensModel::kRadTan, ""},
                                    {"PINHOLE", LensModel::kPinhole, ""},
                                    {"SIMPLE_PINHOLE", LensModel::kPinhole, ""},
                                    {"OPENCV_FISHEYE", LensModel::kEquidistant, ""}};
constexpr std::array<const char*, 6> kNerfCoefficients = {"k1", "k2", "k3", "k4", "p1", "p2"};

/// Frames may have a lens each, which must be that of the first one.
void checkFrames(const KeyedValues& values) {
  const KeyedValues first = values.within("frames[0]");
  for (int i = 0; values.hasPath(fmt::format("frames[{}]", i)); ++i) {
    const KeyedValues frame = values.within(fmt::format("frames[{}]", i));
    for (const char* key : {"camera_model",
                            "fl_x",
                            "fl_y",
                            "cx",
                            "cy",
                            "w",
                            "h",
                            "k1",
                            "k2",
                            "k3",
                            "k4",
                            "p1",
                            "p2"}) {
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

/// transforms.json of nerfstudio and instant-ngp.
Calibration readNerf(const KeyedValues& values) {
  checkFrames(values);
  for (const char* key : {"rolling_shutter", "distortion_params"}) {
    const auto numbers = values.numbers(key);
    if (std::all_of(numbers.begin(), numbers.end(), [](double n) { return n == 0; })) continue;
    throw values.error(key, "is not read here; expected none, or only zeros");
  }
  const bool of_frames = values.has("frames[0].fl_x") && !values.has("fl_x");
  const KeyedValues camera = of_frames ? values.within("frames[0]") : values;
  const KeyedValues& model = camera.has("camera_model") ? camera : values;
  Calibration calibration;
  Lens& lens = calibration.lens;
  if (model.has("camera_model")) {
    lens.model = modelOf(model, "camera_model", kNerfModels).model;
  } else {
    const bool fisheye = values.has("is_fisheye") && values.text("is_fisheye", "") == "true";
    lens.model = fisheye ? LensModel::kEquidistant : LensModel::kRadTan;
  }
  readSize(camera, "w", "h", lens);
  readNerfProjection(camera, lens);
  for (const char* key : kNerfCoefficients) {
    if (!camera.has(key)) continue;
    setParameter(key, camera.number(key), lens, [&](const std::string& what) {
      return camera.error(key, what);
    });
  }
  checkLens(lens, [&](const std::string& what) { return camera.error("fl_x", what); });
  return finished(values, calibration);
}

}  // namespace

Calibration readSettings(const KeyedValues& values, const CameraChoice& choice) {
  if (values.has("fl_x") || values.has("camera_angle_x") || values.hasPath("frames[0]")) {
    return readNerf(values);
  }
  if (values.hasPath("Camera") || values.hasPath("Camera1")) return readOrbs(values, choice);
  if (values.has("model_type")) return readVins(values);
  if (values.hasPath("cameras[0].camera")) return readSvos(values, choice);
  if (values.hasPath("value0.intrinsics[0]")) return readBasalts(values, choice);
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
