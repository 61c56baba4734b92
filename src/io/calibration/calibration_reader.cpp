// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/io/calibration_reader.h"

#include "camera/lens_models.h"
#include "io/calibration/keyed_values.h"
#include "io/text_file.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <strings.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <functional>
#include <iterator>
#include <optional>
#include <string>
#include <string_view>
#include <tuple>
#include <utility>
#include <vector>

namespace dsorb {
namespace {

using io::Field;
using io::KeyedValues;
using Strings = std::vector<std::string>;

constexpr double kMaxSize = 65536;  // of an image [px] a side
constexpr int kMaxCameras = 100;    // of one file
constexpr double kHalfPixel = 0.5;  // where pixels have their centres at .5
// Limits of JSON, which may hold the poses of many images.
constexpr std::size_t kMaxJsonBytes = std::size_t{1} << 23;
constexpr std::size_t kMaxJsonValues = 400000;

// What all forms of calibration files have in common.

/// A lens model as a program calls it, and its parameters in the order or with the keys that it has
/// there: names as "fx fy cx cy k1 [k2]", where those behind the bracket may be missing, of
/// setParameter(), or "key=name".
struct LensWord {
  std::string_view word;  // in large or small letters
  LensModel model;
  std::string_view parameters;
};

using LensWords = std::vector<LensWord>;

/// Checks the numbers of lenses that project by an angle, a sphere or an ellipsoid.
void checkCoefficients(const Lens& lens, const Field& field) {
  const auto [a, b] = std::pair(lens.coefficients[0], lens.coefficients[1]);
  if (lens.model == LensModel::kFov && !(a >= 0 && a < M_PI)) {
    throw field.error(fmt::format("omega {}; expected 0 <= omega < pi", a));
  }
  if (lens.model == LensModel::kDoubleSphere && !(a > -1 && a < 1 && b >= 0 && b <= 1)) {
    throw field.error(
        fmt::format("xi {}, alpha {}; expected -1 < xi < 1 and 0 <= alpha <= 1", a, b));
  }
  if (lens.model == LensModel::kExtendedUnified && !(a >= 0 && a <= 1 && b > 0)) {
    throw field.error(
        fmt::format("alpha {}, beta {}; expected 0 <= alpha <= 1 and beta > 0", a, b));
  }
  if (lens.model == LensModel::kUnified && !(a >= 0)) {
    throw field.error(fmt::format("xi {}; expected at least 0", a));
  }
}

/// One of a list of parameters.
struct Parameter {
  std::string key;
  std::string name;
  bool is_needed;
};

std::vector<Parameter> parametersOf(std::string_view list) {
  std::vector<Parameter> parameters;
  bool is_needed = true;
  for (std::string word : splitWords(list)) {
    is_needed = is_needed && word.front() != '[';
    word.erase(
        std::remove_if(word.begin(), word.end(), [](char c) { return c == '[' || c == ']'; }),
        word.end());
    const std::size_t equals = word.find('=');  // npos + 1 is 0
    parameters.push_back({word.substr(0, equals), word.substr(equals + 1), is_needed});
  }
  return parameters;
}

/// The model of a word, which the field has or stands for.
const LensWord& findLens(const LensWords& models, const std::string& word, const Field& field) {
  Strings known;
  for (const LensWord& model : models) {
    if (strcasecmp(std::string(model.word).c_str(), word.c_str()) == 0) return model;
    known.emplace_back(model.word);
  }
  throw field.error(
      fmt::format("'{}' is no lens model that is known here; expected {}. Where the lens can be "
                  "calibrated with one of docs/calibration.md, write that as camera.txt",
                  quotable(word),
                  fmt::join(known, ", ")));
}

const LensWord& findLens(const LensWords& models, const Field& field) {
  return findLens(models, field.text("a lens model"), field);
}

/// What a readout is read of: parseReadout(), and perhaps "columns" behind it.
constexpr const char* kReadoutKey = "readout_ms";
constexpr const char* kReadoutForm =
    "milliseconds from the first to the last row, -1000 to 1000, or auto, and perhaps 'columns'";

void readReadout(const Field& field, Lens& lens) {
  if (!field.has()) return;
  const Strings words = splitWords(field.text(kReadoutForm));
  const bool columns = words.size() == 2 && words.back() == "columns";
  const auto readout = words.size() == 1 || columns ? parseReadout(words.front()) : std::nullopt;
  if (!readout) throw field.error(fmt::format("{} are expected", kReadoutForm));
  lens.readout = *readout;
  lens.columns = columns;
}

/// Whole numbers from 1 to 65536.
void setSize(double width, double height, Lens& lens, const Field& field) {
  for (const double size : {width, height}) {
    if (!(size >= 1 && size <= kMaxSize) || size != std::floor(size)) {
      throw field.error(
          fmt::format("image size {}x{}; expected positive whole numbers", width, height));
    }
  }
  lens.width = static_cast<int>(width);
  lens.height = static_cast<int>(height);
}

/// The size by the keys that programs have for it, where they are there.
void readSize(const KeyedValues& values, Lens& lens) {
  const std::string width = values.find({"image_width", "image_Width", "width", "cols", "w"});
  const std::string height = values.find({"image_height", "image_Height", "height", "rows", "h"});
  if (width.empty() && height.empty()) return;
  if (width.empty() || height.empty()) {
    throw values.error(width + height, "width and height of the images are expected together");
  }
  setSize(values.number(width), values.number(height), lens, values[width]);
}

/// The size as a list of width and height.
void readSize(const Field& field, Lens& lens) {
  const auto size = field.values.numbers(field.key, 2, "width, height");
  setSize(size[0], size[1], lens, field);
}

/// A parameter of a lens: fx, fy (f: both), cx, cy, or a coefficient as nameOf(model) has them;
/// others must be 0.
void setParameter(std::string_view name, double value, Lens& lens, const Field& field) {
  if (name == "f") lens.fx = lens.fy = value;
  const std::array<std::pair<std::string_view, double*>, 4> plain = {
      {{"fx", &lens.fx}, {"fy", &lens.fy}, {"cx", &lens.cx}, {"cy", &lens.cy}}};
  for (const auto& [own, number] : plain) {
    if (name == own) *number = value;
  }
  if (name.front() == 'f' || name.front() == 'c') return;
  const LensModelName& model = nameOf(lens.model);
  const Strings names = splitWords(model.coefficient_names);
  const auto place = std::find(names.begin(), names.end(), name);
  if (place != names.end()) {
    lens.coefficients[static_cast<std::size_t>(place - names.begin())] = value;
  } else if (value != 0) {
    throw field.error(
        fmt::format("the distortion coefficient {} is {}, which lenses of the model {} "
                    "do not have here ({}); calibrate without it, or with a model of "
                    "docs/calibration.md",
                    name,
                    value,
                    model.name,
                    names.empty() ? "no distortion" : model.coefficient_names));
  }
}

/// Parameters in the order of a list.
void setParameters(std::string_view list,
                   const std::vector<double>& values,
                   Lens& lens,
                   const Field& field) {
  const std::vector<Parameter> parameters = parametersOf(list);
  const bool too_few = values.size() < parameters.size() && parameters[values.size()].is_needed;
  if (values.size() > parameters.size() || too_few) {
    throw field.error(fmt::format("{} numbers; expected '{}'", values.size(), list));
  }
  for (std::size_t i = 0; i < values.size(); ++i) {
    setParameter(parameters[i].name, values[i], lens, field);
  }
}

void setParameters(std::string_view list, const Field& field, Lens& lens) {
  setParameters(list, field.numbers(), lens, field);
}

/// Parameters by keys of their own.
/// @param groups that a key may stand in, each with the dot behind it
/// @return key of the first one
std::string readParameters(const KeyedValues& values,
                           std::string_view list,
                           Lens& lens,
                           const Strings& groups = {""}) {
  std::string first;
  for (const Parameter& parameter : parametersOf(list)) {
    Strings keys;
    keys.reserve(groups.size());
    for (const std::string& group : groups) keys.push_back(group + parameter.key);
    const std::string key = values.find(keys);
    if (first.empty()) first = key;
    if (!key.empty()) setParameter(parameter.name, values.number(key), lens, values[key]);
    if (key.empty() && parameter.is_needed) {
      throw values.error(keys.front(), "is missing; a number is expected");
    }
  }
  return first;
}

/// Focal lengths, the range of a sphere's coefficients, and a principal point inside of the image,
/// where its size is known.
void checkLens(const Lens& lens, const Field& field) {
  if (!(lens.fx > 0 && lens.fy > 0)) {
    throw field.error(
        fmt::format("focal lengths {} {}; expected positive numbers", lens.fx, lens.fy));
  }
  checkCoefficients(lens, field);
  if (lens.width == 0) return;
  if (lens.cx >= 0 && lens.cy >= 0 && lens.cx < lens.width && lens.cy < lens.height) return;
  throw field.error(fmt::format("principal point {} {}; expected inside the image of {}",
                                lens.cx,
                                lens.cy,
                                pixelText(lens.width, lens.height)));
}

/// A calibration, once its lens was checked and is of the plainest model that says the same: images
/// without a distortion are not resampled. The file may say the readout, too.
Calibration finished(const Field& field, Lens lens) {
  checkLens(lens, field);
  const auto& k = lens.coefficients;
  if (lens.model == LensModel::kRational && k[5] == 0 && k[6] == 0 && k[7] == 0) {
    lens.model = LensModel::kRadTan;
  }
  Calibration calibration;
  if (!isDistorted(lens)) {
    lens.model = LensModel::kPinhole;
    calibration.rectification.mode = RectificationMode::kNone;
  }
  readReadout(field.values[kReadoutKey], lens);
  calibration.lens = lens;
  return calibration;
}

/// One camera of a calibration file.
struct NamedCamera {
  Strings names;  // the first one is that of messages; empty: it has none
  std::function<Calibration()> read;
};

constexpr int kFolders = 3;  // of a path that may be called as a camera: mav0/cam1/data.csv

bool isTopic(const std::string& name) {
  return !name.empty() && name.front() == '/';
}

/// Without the ending that image_transport gives the topic of other encodings.
std::string_view plainTopic(std::string_view topic) {
  for (const std::string_view ending : {"/compressed", "/compressedDepth", "/theora"}) {
    if (topic.size() > ending.size() && topic.substr(topic.size() - ending.size()) == ending) {
      topic.remove_suffix(ending.size());
    }
  }
  return topic;
}

bool isCalled(const NamedCamera& camera, std::string_view name) {
  return std::any_of(camera.names.begin(), camera.names.end(), [&](const std::string& own) {
    return isTopic(own) ? plainTopic(own) == plainTopic(name) : own == name;
  });
}

/// The camera that the last folder is called after that is called after one.
const NamedCamera* findFolder(const std::vector<NamedCamera>& cameras,
                              const std::filesystem::path& path,
                              int folders) {
  const std::vector<std::filesystem::path> parts(path.begin(), path.end());
  for (auto part = parts.rbegin(); part != parts.rend() && folders > 0; ++part, --folders) {
    for (const NamedCamera& camera : cameras) {
      if (isCalled(camera, part->string()) || isCalled(camera, part->stem().string())) {
        return &camera;
      }
    }
  }
  return nullptr;
}

const NamedCamera* find(const std::vector<NamedCamera>& cameras, const CameraChoice& choice) {
  if (choice.name.empty()) return findFolder(cameras, choice.images, kFolders);
  const auto called = std::find_if(cameras.begin(), cameras.end(), [&](const NamedCamera& camera) {
    return isCalled(camera, choice.name);
  });
  if (called != cameras.end()) return &*called;
  if (!isTopic(choice.name)) return nullptr;
  const std::filesystem::path topic = choice.name;
  return findFolder(cameras, topic, static_cast<int>(std::distance(topic.begin(), topic.end())));
}

bool areSame(const Calibration& a, const Calibration& b) {
  const auto numbers = [](const Lens& l) {
    return std::tuple(std::tuple(l.model, l.fx, l.fy, l.cx, l.cy, l.coefficients),
                      std::tuple(l.width, l.height),
                      std::tuple(l.readout.seconds, l.readout.sigma, l.columns));
  };
  return numbers(a.lens) == numbers(b.lens);
}

/// Whether it does not matter which one is meant.
bool areAllSame(const std::vector<NamedCamera>& cameras) {
  try {
    const Calibration first = cameras.front().read();
    return std::all_of(cameras.begin() + 1, cameras.end(), [&](const NamedCamera& camera) {
      return areSame(first, camera.read());
    });
  } catch (const IoError&) {
    return false;
  }
}

std::string listed(const std::vector<NamedCamera>& cameras) {
  std::string list;
  for (const NamedCamera& camera : cameras) {
    list += fmt::format("{}{}", list.empty() ? "" : ", ", camera.names.front());
    if (isTopic(camera.names.back())) list += fmt::format(" ({})", camera.names.back());
  }
  return list;
}

/// The calibration of the camera that is chosen, or of all where they are the same.
/// @throws IoError that lists them where none is chosen, or one that is not there
Calibration readChosen(const std::filesystem::path& file,
                       const std::vector<NamedCamera>& cameras,
                       const CameraChoice& choice) {
  if (cameras.empty()) throw lineError(file, 0, "has no camera; at least one is expected");
  const bool nameless = cameras.size() == 1 && cameras.front().names.empty();
  if (nameless) return cameras.front().read();
  if (const NamedCamera* camera = find(cameras, choice)) return camera->read();
  if (!choice.name.empty() && (cameras.size() > 1 || !isTopic(choice.name))) {
    throw lineError(file,
                    0,
                    fmt::format("has no camera '{}'; choose one with --camera: {}",
                                quotable(choice.name),
                                listed(cameras)));
  }
  if (cameras.size() == 1 || areAllSame(cameras)) return cameras.front().read();
  throw lineError(
      file,
      0,
      fmt::format("has {} cameras, and the images do not say which one took them; choose it with "
                  "--camera: {}",
                  cameras.size(),
                  listed(cameras)));
}

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
  setParameters("fx fy cx cy", {k[0], k[4], k[2], k[5]}, lens, values[key]);
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
      omnidir ? kRosModels.front() : findLens(kRosModels, word, values[model_key]);
  lens.model = omnidir ? LensModel::kUnified : model.model;
  setParameters(model.parameters, values[key], lens);
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
  setSize(std::floor(cut_width / bin_x), std::floor(cut_height / bin_y), lens, values["binning_x"]);
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
                         Calibration calibration = finished(values[matrix], lens);
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
  const LensWord& projection = findLens(kKalibrProjections, camera, values["camera_model"]);
  const std::string distortion = values.text("distortion_model", "the model of the distortion");
  const LensWord& model =
      findLens(kKalibrModels, camera + " " + distortion, values["distortion_model"]);
  Lens lens{model.model};
  setParameters(projection.parameters, values["intrinsics"], lens);
  readSize(values["resolution"], lens);
  const char* key =
      values.has("distortion_coeffs") ? "distortion_coeffs" : "distortion_coefficients";
  if (!model.parameters.empty()) {
    setParameters(model.parameters, values[key], lens);
  } else if (!isZero(values.numbers(key))) {
    throw values.error(key, "numbers, but distortion_model is none");
  }
  return finished(values["intrinsics"], lens);
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
  const LensWord& model = key.empty() ? kOrbModels.front() : findLens(kOrbModels, camera[key]);
  Lens lens{model.model};
  readSize(camera, lens);
  readParameters(values.within(group), model.parameters, lens);
  return finished(values[group + ".fx"], lens);
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
  const LensWord& model = findLens(kVinsModels, values[key]);
  Lens lens{model.model};
  readSize(values, lens);
  const std::string first = readParameters(values, model.parameters, lens, kVinsGroups);
  if (values.has("rolling_shutter") && values.number("rolling_shutter") != 0) {
    lens.readout.seconds = values.number("rolling_shutter_tr");
  }
  return finished(values[first], lens);
}

// SVO and aslam: a list of cameras.

const LensWords kSvoModels = {{"none", LensModel::kPinhole, ""},
                              {"radial-tangential", LensModel::kRadTan, "[k1 k2 p1 p2 k3]"},
                              {"equidistant", LensModel::kEquidistant, "[k1 k2 k3 k4]"},
                              {"fisheye", LensModel::kFov, "[omega]"}};

Calibration readSvo(const KeyedValues& camera, int /*number*/) {
  const auto model = [&](const LensWords& models, const std::string& key) {
    return findLens(models, camera[key]);
  };
  (void)model({{"pinhole", LensModel::kPinhole, ""}}, "type");
  const LensWord distortion = model(kSvoModels, "distortion.type");
  const char* intrinsics = camera.has("intrinsics") ? "intrinsics" : "intrinsics.data";
  const std::string key = camera.find({"distortion.parameters", "distortion.parameters.data"});
  Lens lens{distortion.model};
  readSize(camera, lens);
  setParameters("fx fy cx cy", camera[intrinsics], lens);
  if (lens.model != LensModel::kPinhole) {  // for which SVO writes four zeros
    setParameters(distortion.parameters, camera[key], lens);
  }
  if (camera.has("line-delay-nanoseconds") && lens.height > 0) {
    lens.readout.seconds = 1e-9 * camera.number("line-delay-nanoseconds") * (lens.height - 1);
  }
  return finished(camera[intrinsics], lens);
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
  const LensWord& model = findLens(kBasaltModels, camera[key]);
  Lens lens{model.model};
  lens.coefficients[1] = model.word == "ucm" ? 1 : 0;  // beta
  readSize(values[fmt::format("value0.resolution[{}]", number)], lens);
  readParameters(camera.within("intrinsics"), model.parameters, lens);
  return finished(values[basaltPath(number) + ".intrinsics.fx"], lens);
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
  lens.model = named.has(key) ? findLens(kNerfModels, named[key]).model
               : fisheye      ? LensModel::kEquidistant
                              : LensModel::kRadTan;
  readSize(camera, lens);
  readNerfProjection(camera, lens);
  readParameters(camera, kNerfNumbers, lens);
  return finished(values[of_frames ? "frames[0].fl_x" : "fl_x"], lens);
}

/// Lens of a YAML, JSON or XML file of any program that is known.
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

/// First line of camera.txt.
const LensWords kModels = {
    {"Pinhole", LensModel::kPinhole, "fx fy cx cy [omega]"},  // which is 0
    {"FOV", LensModel::kFov, "fx fy cx cy omega"},
    {"RadTan", LensModel::kRadTan, "fx fy cx cy k1 k2 p1 p2 [k3]"},
    {"EquiDistant", LensModel::kEquidistant, "fx fy cx cy k1 k2 k3 k4"},
    {"KannalaBrandt", LensModel::kEquidistant, "fx fy cx cy k1 k2 k3 k4"},
    {"Rational", LensModel::kRational, "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"},
    {"DoubleSphere", LensModel::kDoubleSphere, "fx fy cx cy xi alpha"},
    {"EUCM", LensModel::kExtendedUnified, "fx fy cx cy alpha beta"},
    {"Unified", LensModel::kUnified, "fx fy cx cy xi [k1 k2 p1 p2]"}};

// What the lines of camera.txt are, as messages call them.
constexpr const char* kModel = "camera model";
constexpr const char* kInputSize = "input width and height";
constexpr const char* kOutput = "output camera";
constexpr const char* kOutputSize = "output width and height";

/// The words of camera.txt by what their line is.
KeyedValues dsoValues(const std::filesystem::path& file, const std::vector<TextLine>& lines) {
  constexpr std::array<const char*, 4> kLines = {kModel, kInputSize, kOutput, kOutputSize};
  KeyedValues values(file);
  for (std::size_t i = 0; i < lines.size(); ++i) {
    Strings words = splitWords(lines[i].text);
    const bool readout = i > 0 && i + 1 == lines.size() && words.front() == "readout";
    if (!readout && i >= kLines.size()) {
      throw lines[i].error("more than four lines");
    }
    if (readout) words.erase(words.begin());
    values.add(readout ? kReadoutKey : kLines.at(i), {words, lines[i].number});
  }
  return values;
}

/// First line of camera.txt; without a name its numbers tell the model.
void readModel(const KeyedValues& values, Lens& lens) {
  if (!values.has(kModel)) {
    throw values.error("", "is empty; expected a camera model, as 'Pinhole fx fy cx cy 0'");
  }
  Strings words = splitWords(values.text(kModel, ""));
  double last = 0;
  if (!parseNumber(words.front(), last)) {
    // It has a name.
  } else if (words.size() == 8) {
    words.insert(words.begin(), "RadTan");
  } else if (words.size() == 5 && parseNumber(words.back(), last)) {
    words.insert(words.begin(), last == 0 ? "Pinhole" : "FOV");
  } else {
    throw values.error(
        kModel,
        fmt::format("{} numbers without a name; expected 5 (Pinhole or FOV) or 8 (RadTan)",
                    words.size()));
  }
  const LensWord& model = findLens(kModels, words.front(), values[kModel]);
  words.erase(words.begin());
  KeyedValues numbers(values.file());
  numbers.add(kModel, {words, values.all().at(kModel).line});
  lens.model = model.model;
  setParameters(model.parameters, numbers[kModel], lens);
}

/// Relative intrinsics let pixel (0, 0) cover [0, 1]; ours has its centre at (0, 0).
/// @tparam Camera with members fx, fy, cx, cy
template <typename Camera>
void scaleToPixels(int width, int height, Camera& camera) {
  camera.fx *= width;
  camera.fy *= height;
  camera.cx = camera.cx * width - kHalfPixel;
  camera.cy = camera.cy * height - kHalfPixel;
}

/// Third line: a word, or the relative intrinsics of the output camera.
void readMode(const KeyedValues& values, Rectification& target) {
  const std::string text = values.text(kOutput, "");
  const std::array<std::pair<const char*, RectificationMode>, 3> modes = {
      {{"crop", RectificationMode::kCrop},
       {"full", RectificationMode::kFull},
       {"none", RectificationMode::kNone}}};
  for (const auto& [word, mode] : modes) {
    target.mode = mode;
    if (text == word) return;
  }
  const std::string what = "crop, full, none, or relative 'fx fy cx cy 0'";
  double number = 0;
  if (!parseNumber(splitWords(text).front(), number)) {
    throw values.error(kOutput, fmt::format("'{}'; expected {}", quotable(text), what));
  }
  const std::vector<double> n = values.numbers(kOutput, 5, what);
  if (!(n[0] > 0 && n[1] > 0 && n[2] >= 0 && n[2] <= 1 && n[3] >= 0 && n[3] <= 1 && n[4] == 0)) {
    throw values.error(kOutput,
                       fmt::format("'{}'; expected intrinsics relative to the output size: "
                                   "positive focal lengths, principal point between 0 and 1, "
                                   "and 0 for no distortion",
                                   quotable(text)));
  }
  target.mode = RectificationMode::kExplicit;
  target.camera.fx = n[0];
  target.camera.fy = n[1];
  target.camera.cx = n[2];
  target.camera.cy = n[3];
}

void readRectification(const KeyedValues& values, Calibration& calibration) {
  Rectification& target = calibration.rectification;
  const Lens& lens = calibration.lens;
  Lens output = lens;
  if (values.has(kOutput)) readMode(values, target);
  if (values.has(kOutputSize)) readSize(values[kOutputSize], output);
  target.width = output.width;
  target.height = output.height;
  if (target.mode == RectificationMode::kExplicit) {
    scaleToPixels(target.width, target.height, target.camera);
  }
  if (target.mode != RectificationMode::kNone) return;
  if (isDistorted(lens)) {
    throw values.error(kOutput,
                       fmt::format("'none' would leave the distortion of the {} lens of line 1 in "
                                   "the images; expected crop or full. Of images that are "
                                   "undistorted already, line 1 is 'Pinhole fx fy cx cy 0'",
                                   nameOf(lens.model).name));
  }
  if (target.width != lens.width || target.height != lens.height) {
    throw values.error(kOutputSize,
                       fmt::format("'none' cannot turn {} into {}; expected equal sizes, or crop",
                                   pixelText(lens.width, lens.height),
                                   pixelText(target.width, target.height)));
  }
}

/// camera.txt of DSO.
Calibration readDso(const KeyedValues& values) {
  Lens lens;
  readModel(values, lens);
  readSize(values[kInputSize], lens);
  if (lens.cx < 1 && lens.cy < 1) scaleToPixels(lens.width, lens.height, lens);
  Calibration calibration = finished(values[kModel], lens);
  readRectification(values, calibration);
  return calibration;
}

/// "KEY: words" a line.
KeyedValues keyed(const std::filesystem::path& file, const std::vector<TextLine>& lines) {
  KeyedValues values(file);
  for (const TextLine& line : lines) {
    const std::size_t colon = line.text.find(':');
    if (colon == std::string::npos) continue;
    values.add(line.text.substr(0, colon), {splitWords(line.text.substr(colon + 1)), line.number});
  }
  return values;
}

/// fx, fy, cx, cy of a 3x3 matrix, or of a 3x4 one of a rectified camera, whose last column is
/// where it stands.
void readProjection(const KeyedValues& values, const std::string& key, Lens& lens) {
  const std::size_t columns = key.front() == 'K' ? 3 : 4;
  const auto m = values.numbers(
      key, 3 * columns, fmt::format("the {} of a 3x{} matrix", 3 * columns, columns));
  const auto at = [&](std::size_t row, std::size_t column) { return m[row * columns + column]; };
  if (at(0, 1) != 0 || at(1, 0) != 0 || at(2, 0) != 0 || at(2, 1) != 0 || at(2, 2) != 1) {
    throw values.error(key, "expected fx 0 cx, 0 fy cy, 0 0 1 in the first three columns");
  }
  setParameters("fx fy cx cy", {at(0, 0), at(1, 1), at(0, 2), at(1, 2)}, lens, values[key]);
}

/// Both kinds of images have the calibration of their size; most recordings are rectified.
Calibration readRaw(const KeyedValues& values, const std::string& number, const CameraChoice& c) {
  Lens raw;
  Lens rectified;
  const std::string raw_size = "S_" + number, rectified_size = "S_rect_" + number;
  if (values.has(raw_size)) readSize(values[raw_size], raw);
  if (values.has(rectified_size)) readSize(values[rectified_size], rectified);
  const auto fits = [&](const Lens& l) { return l.width == c.width && l.height == c.height; };
  const std::string projection = "P_rect_" + number, matrix = "K_" + number;
  if (values.has(projection) && (fits(rectified) || !fits(raw))) {
    readProjection(values, projection, rectified);
    return finished(values[projection], rectified);
  }
  readProjection(values, matrix, raw);
  raw.model = LensModel::kRadTan;
  const std::string distortion = "D_" + number;
  setParameters("k1 k2 p1 p2 k3", values[distortion], raw);
  return finished(values[matrix], raw);
}

/// KITTI's calib.txt, where image_2 is P2, and calib_cam_to_cam.txt, where image_02 is P_rect_02,
/// or K_02 and D_02 for images of the size of raw ones.
bool isKitti(const std::vector<TextLine>& lines) {
  return std::any_of(lines.begin(), lines.end(), [](const TextLine& line) {
    const std::string key = line.text.substr(0, line.text.find(':'));
    const bool odometry = key.size() == 2 && key[0] == 'P' && key[1] >= '0' && key[1] <= '3';
    return key.size() < line.text.size() &&
           (odometry || key.compare(0, 7, "P_rect_") == 0 || key.compare(0, 3, "K_0") == 0);
  });
}

Calibration readKitti(const std::filesystem::path& file,
                      const std::vector<TextLine>& lines,
                      const CameraChoice& choice) {
  const KeyedValues values = keyed(file, lines);
  std::vector<NamedCamera> cameras;
  for (const char number : {'0', '1', '2', '3'}) {
    const std::string projection = std::string("P") + number;
    const std::string two = std::string("0") + number;
    if (values.has(projection)) {
      cameras.push_back({{std::string("image_") + number, projection, std::string(1, number)},
                         [&values, projection] {
                           Lens lens;
                           readProjection(values, projection, lens);
                           return finished(values[projection], lens);
                         }});
    } else if (values.has("P_rect_" + two) || values.has("K_" + two)) {
      cameras.push_back({{"image_" + two, two, "P_rect_" + two, "K_" + two},
                         [&values, two, choice] { return readRaw(values, two, choice); }});
    }
  }
  return readChosen(file, cameras, choice);
}

/// A line of COLMAP's cameras.txt.
/// @source COLMAP's documentation, "Camera Models"
const LensWords kColmapModels = {
    {"SIMPLE_PINHOLE", LensModel::kPinhole, "f cx cy"},
    {"PINHOLE", LensModel::kPinhole, "fx fy cx cy"},
    {"SIMPLE_RADIAL", LensModel::kRadTan, "f cx cy k1"},
    {"RADIAL", LensModel::kRadTan, "f cx cy k1 k2"},
    {"OPENCV", LensModel::kRadTan, "fx fy cx cy k1 k2 p1 p2"},
    {"FULL_OPENCV", LensModel::kRational, "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"},
    {"OPENCV_FISHEYE", LensModel::kEquidistant, "fx fy cx cy k1 k2 k3 k4"},
    {"SIMPLE_RADIAL_FISHEYE", LensModel::kEquidistant, "f cx cy k1"},
    {"RADIAL_FISHEYE", LensModel::kEquidistant, "f cx cy k1 k2"},
    {"FOV", LensModel::kFov, "fx fy cx cy omega"}};

Calibration readColmapCamera(const Field& field, const std::string& word) {
  const LensWord& model = findLens(kColmapModels, word, field);
  std::vector<double> numbers = field.numbers();
  Lens lens{model.model};
  setSize(numbers[0], numbers[1], lens, field);
  numbers.erase(numbers.begin(), numbers.begin() + 2);
  setParameters(model.parameters, numbers, lens, field);
  lens.cx -= kHalfPixel;
  lens.cy -= kHalfPixel;
  return finished(field, lens);
}

/// Lines of a number, a name in capitals, and more.
bool isColmap(const std::vector<TextLine>& lines) {
  if (lines.empty()) return false;
  const Strings words = splitWords(lines.front().text);
  double id = 0;
  return words.size() > 2 && parseNumber(words[0], id) && words[1].size() > 2 &&
         std::all_of(words[1].begin(),
                     words[1].end(),
                     [](unsigned char c) {
                       return std::isupper(c) != 0 || std::isdigit(c) != 0 || c == '_';
                     }) &&
         std::isupper(static_cast<unsigned char>(words[1].front())) != 0;
}

Calibration readColmap(const std::filesystem::path& file,
                       const std::vector<TextLine>& lines,
                       const CameraChoice& choice) {
  std::vector<NamedCamera> cameras;
  cameras.reserve(lines.size());
  for (const TextLine& line : lines) {
    const Strings words = splitWords(line.text);
    cameras.push_back({{words[0]}, [&file, &line, words] {
                         if (words.size() < 4) {
                           throw line.error("expected 'ID MODEL width height ...'");
                         }
                         KeyedValues values(file);
                         values.add(words[0], {{words.begin() + 2, words.end()}, line.number});
                         return readColmapCamera(values[words[0]], words[1]);
                       }});
  }
  return readChosen(file, cameras, choice);
}

}  // namespace

std::optional<Readout> parseReadout(std::string_view text) {
  if (text == "auto") return kUnknownReadout;
  double milliseconds = 0;
  if (!parseNumber(text, milliseconds) || !(std::abs(milliseconds) <= kMaxReadoutMs)) {
    return std::nullopt;
  }
  return Readout{milliseconds / 1000, 0};
}

Calibration readCalibration(const std::filesystem::path& file, const CameraChoice& choice) {
  const std::string suffix = file.extension().string();
  if (suffix == ".yaml" || suffix == ".yml") {
    return readKeyed(io::yamlValues(readText(file, kMaxYamlBytes), file), choice);
  }
  if (suffix == ".json") {
    return readKeyed(io::yamlValues(readText(file, kMaxJsonBytes), file, kMaxJsonValues), choice);
  }
  if (suffix == ".xml") {
    return readKeyed(io::xmlValues(file, readText(file, kMaxCalibrationBytes)), choice);
  }
  const std::vector<TextLine> lines = readLines(file, kMaxCalibrationBytes);
  if (isKitti(lines)) return readKitti(file, lines, choice);
  if (isColmap(lines)) return readColmap(file, lines, choice);
  return readDso(dsoValues(file, lines));
}

}  // namespace dsorb
