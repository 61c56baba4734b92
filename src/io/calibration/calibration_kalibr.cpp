// SPDX-License-Identifier: BSD-3-Clause
#include "io/calibration/calibration_forms.h"
#include "io/calibration/camera_choice.h"
#include "io/calibration/lens_numbers.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <string>
#include <string_view>
#include <vector>

namespace dsorb {
namespace {

using io::KeyedValues;

/// A pair of words for projection and distortion, and what their numbers are.
struct KalibrModel {
  std::string_view camera;
  std::string_view distortion;
  LensModel model;
  const char* intrinsics;
  const char* coefficients;
};

/// @source Kalibr's wiki, "Supported models"; EuRoC has longer names
constexpr const char* kPlain = "fx fy cx cy";
constexpr std::array<KalibrModel, 11> kKalibrModels = {{
    {"pinhole", "radtan", LensModel::kRadTan, kPlain, "k1 k2 p1 p2 k3"},
    {"pinhole", "radial-tangential", LensModel::kRadTan, kPlain, "k1 k2 p1 p2 k3"},
    {"pinhole", "plumb_bob", LensModel::kRadTan, kPlain, "k1 k2 p1 p2 k3"},
    {"pinhole", "equidistant", LensModel::kEquidistant, kPlain, "k1 k2 k3 k4"},
    {"pinhole", "fov", LensModel::kFov, kPlain, "omega"},
    {"pinhole", "none", LensModel::kPinhole, kPlain, ""},
    {"omni", "radtan", LensModel::kUnified, "xi fx fy cx cy", "k1 k2 p1 p2"},
    {"omni", "radial-tangential", LensModel::kUnified, "xi fx fy cx cy", "k1 k2 p1 p2"},
    {"omni", "none", LensModel::kUnified, "xi fx fy cx cy", ""},
    {"ds", "none", LensModel::kDoubleSphere, "xi alpha fx fy cx cy", ""},
    {"eucm", "none", LensModel::kExtendedUnified, "alpha beta fx fy cx cy", ""},
}};

/// The words of one column without repetitions, of the models that a predicate holds for.
template <typename Predicate>
std::string wordsOf(std::string_view KalibrModel::*word, const Predicate& holds) {
  std::string list;
  std::string_view last;
  for (const KalibrModel& model : kKalibrModels) {
    if (!holds(model) || model.*word == last) continue;
    last = model.*word;
    list += (list.empty() ? "" : ", ") + std::string(last);
  }
  return list;
}

const KalibrModel& modelOf(const KeyedValues& values) {
  const std::string all = wordsOf(&KalibrModel::camera, [](const KalibrModel&) { return true; });
  const std::string camera = values.text("camera_model", all);
  const auto is_camera = [&](const KalibrModel& model) { return model.camera == camera; };
  if (std::none_of(kKalibrModels.begin(), kKalibrModels.end(), is_camera)) {
    throw values.error("camera_model", fmt::format("'{}'; expected {}", quotable(camera), all));
  }
  const std::string these = wordsOf(&KalibrModel::distortion, is_camera);
  const std::string distortion = values.text("distortion_model", these);
  const auto* model =
      std::find_if(kKalibrModels.begin(), kKalibrModels.end(), [&](const KalibrModel& m) {
        return is_camera(m) && m.distortion == distortion;
      });
  if (model != kKalibrModels.end()) return *model;
  throw values.error(
      "distortion_model",
      fmt::format(
          "'{}'; expected, with the camera model {}, {}", quotable(distortion), camera, these));
}

Calibration readCamera(const KeyedValues& values) {
  const KalibrModel& model = modelOf(values);
  Calibration calibration;
  Lens& lens = calibration.lens;
  lens.model = model.model;
  const auto complain = [&](const char* key) {
    return [&values, key](const std::string& what) { return values.error(key, what); };
  };
  const std::size_t count = splitWords(model.intrinsics).size();
  setParameters(model.intrinsics,
                values.numbers("intrinsics", {count}, model.intrinsics),
                lens,
                complain("intrinsics"));
  const auto resolution = values.numbers("resolution", {2}, "width, height");
  setSize(resolution[0], resolution[1], lens, complain("resolution"));
  const char* key =
      values.has("distortion_coeffs") ? "distortion_coeffs" : "distortion_coefficients";
  const std::size_t most = splitWords(model.coefficients).size();
  if (most > 0) {
    const std::size_t least = std::min<std::size_t>(most, 4);
    setParameters(model.coefficients,
                  values.numbers(key, {least, most}, model.coefficients),
                  lens,
                  complain(key));
  } else if (const auto rest = values.numbers(key);
             std::any_of(rest.begin(), rest.end(), [](double k) { return k != 0; })) {
    throw values.error(key, "numbers, but distortion_model is none");
  }
  checkLens(lens, complain("intrinsics"));
  readReadoutKey(values, lens);
  simplify(calibration);
  return calibration;
}

/// Keys of the cameras of a chain; one of sensor.yaml has none.
std::vector<std::string> camerasOf(const KeyedValues& values) {
  std::vector<std::string> keys;
  for (int i = 0; i < 100; ++i) {
    std::string key = fmt::format("cam{}", i);
    if (values.hasPath(key)) keys.push_back(std::move(key));
  }
  return keys;
}

}  // namespace

bool isKalibr(const KeyedValues& values) {
  return values.has("camera_model") || !camerasOf(values).empty();
}

Calibration readKalibr(const KeyedValues& values, const CameraChoice& choice) {
  std::vector<NamedCamera> cameras;
  for (const std::string& key : camerasOf(values)) {
    const KeyedValues camera = values.within(key);
    if (camera.empty()) throw values.error(key, "a mapping with camera_model is expected");
    NamedCamera named{{key}, [camera] { return readCamera(camera); }};
    if (camera.has("rostopic")) named.names.push_back(camera.text("rostopic", "a topic"));
    cameras.push_back(std::move(named));
  }
  if (cameras.empty()) cameras.push_back({{}, [&values] { return readCamera(values); }});
  return readChosen(values.file(), cameras, choice);
}

}  // namespace dsorb
