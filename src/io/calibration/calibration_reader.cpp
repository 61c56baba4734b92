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
#include <cctype>
#include <cmath>
#include <functional>
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

/// A lens model as a program calls it ("a|b" by two names, in large or small letters), and its
/// parameters there: names of setParameter() in their order, where those behind a bracket may be
/// missing; "key=name" where its key is another; "1=name" where it is 1. A bar ends a list and
/// begins the next one.
struct LensWord {
  std::string_view word;
  LensModel model;
  std::string_view parameters;
};

using LensWords = std::vector<LensWord>;

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
    word.erase(0, word.find_first_not_of('['));
    word.erase(std::min(word.find(']'), word.size()));
    const std::size_t equals = word.find('=');  // npos + 1 is 0
    parameters.push_back({word.substr(0, equals), word.substr(equals + 1), is_needed});
  }
  return parameters;
}

/// The model of this name, or the first whose name begins with these words.
const LensWord& findLens(const LensWords& models, const std::string& words, const Field& field) {
  Strings known;
  for (const LensWord& model : models) {
    for (std::string name : io::spellings(model.word)) {
      if (words.find(' ') == std::string::npos) name.erase(std::min(name.find(' '), name.size()));
      if (strcasecmp(name.c_str(), words.c_str()) == 0) return model;
      if (std::find(known.begin(), known.end(), name) == known.end()) known.push_back(name);
    }
  }
  throw field.error(
      "'{}' is no lens model that is known here; expected {}. Where the lens can be calibrated "
      "with one of docs/calibration.md, write that as camera.txt",
      quotable(words),
      fmt::join(known, ", "));
}

/// What a readout is read of: parseReadout(), and perhaps "columns" behind it.
constexpr const char* kReadoutForm =
    "milliseconds from the first to the last row, -1000 to 1000, or auto, and perhaps 'columns'";

/// Our own key, that of VINS, and that of SVO.
void readReadout(const KeyedValues& values, Lens& lens) {
  for (const std::string& word : values["rolling_shutter"].content.words) {
    double rolling = 0;  // in files of others it is a word
    if (!parseNumber(word, rolling) || rolling == 0) continue;
    lens.readout.seconds = values["rolling_shutter_tr"].number();
  }
  const Field line = values["line-delay-nanoseconds"];
  if (line.has() && lens.height > 0) {
    lens.readout.seconds = 1e-9 * line.number() * (lens.height - 1);
  }
  const Field field = values["readout_ms|readout"];
  if (!field.has()) return;
  const Strings words = splitWords(field.text(kReadoutForm));
  const bool columns = words.size() == 2 && words.back() == "columns";
  const auto readout = words.size() == 1 || columns ? parseReadout(words.front()) : std::nullopt;
  if (!readout) throw field.error("{} are expected", kReadoutForm);
  lens.readout = *readout;
  lens.columns = columns;
}

/// Whole numbers from 1 to 65536.
void setSize(double width, double height, Lens& lens, const Field& field) {
  for (const double size : {width, height}) {
    if (!(size >= 1 && size <= kMaxSize) || size != std::floor(size)) {
      throw field.error("image size {}x{}; expected positive whole numbers", width, height);
    }
  }
  lens.width = static_cast<int>(width);
  lens.height = static_cast<int>(height);
}

/// The size by the keys that programs have for it, where they are there.
void readSize(const KeyedValues& values, Lens& lens) {
  const Field width = values["image_width|image_Width|width|cols|w"];
  const Field height = values["image_height|image_Height|height|rows|h"];
  if (width.has() != height.has()) {
    throw(width.has() ? width : height)
        .error("width and height of the images are expected together");
  }
  if (width.has()) setSize(width.number(), height.number(), lens, width);
}

/// The size as a list of width and height.
void readSize(const Field& field, Lens& lens) {
  const auto size = field.numbers(2, "width, height");
  setSize(size[0], size[1], lens, field);
}

/// A parameter of a lens: fx, fy (f: both), cx, cy, or a coefficient as nameOf(model) has them;
/// others must be 0.
void setParameter(std::string_view name, double value, Lens& lens, const Field& field) {
  if (name == "f" || name == "fx") lens.fx = value;
  if (name == "f" || name == "fy") lens.fy = value;
  if (name == "cx") lens.cx = value;
  if (name == "cy") lens.cy = value;
  if (name.front() == 'f' || name.front() == 'c') return;
  const LensModelName& model = nameOf(lens.model);
  const Strings names = splitWords(model.coefficient_names);
  const auto place = std::find(names.begin(), names.end(), name);
  if (place != names.end()) {
    lens.coefficients[static_cast<std::size_t>(place - names.begin())] = value;
  } else if (value != 0) {
    throw field.error(
        "the distortion coefficient {} is {}, which lenses of the model {} do not have here ({}); "
        "calibrate without it, or with a model of docs/calibration.md",
        name,
        value,
        model.name,
        names.empty() ? "no distortion" : model.coefficient_names);
  }
}

/// Parameters in the order of a list. Where it has none, all numbers must be 0.
void setParameters(std::string_view list,
                   const std::vector<double>& values,
                   Lens& lens,
                   const Field& field) {
  const std::vector<Parameter> parameters = parametersOf(list);
  const bool too_few = values.size() < parameters.size() && parameters[values.size()].is_needed;
  const auto zeros = std::count(values.begin(), values.end(), 0.0);
  if (list.empty() && zeros == static_cast<std::ptrdiff_t>(values.size())) return;
  if (values.size() > parameters.size() || too_few) {
    throw field.error(
        "{} numbers; expected {}",
        values.size(),
        list.empty() ? "none of a lens without distortion" : fmt::format("'{}'", list));
  }
  for (std::size_t i = 0; i < values.size(); ++i) {
    setParameter(parameters[i].name, values[i], lens, field);
  }
}

/// Parameters by keys of their own.
/// @param groups that a key may stand in, each with the dot behind it
/// @return the first one
Field readParameters(const KeyedValues& values,
                     std::string_view list,
                     Lens& lens,
                     const Strings& groups = {""}) {
  std::optional<Field> first;
  for (const Parameter& parameter : parametersOf(list)) {
    std::string spellings;
    for (const std::string& group : groups) {
      spellings += (spellings.empty() ? "" : "|") + group + parameter.key;
    }
    const Field field = values[spellings];
    double constant = 0;
    if (parseNumber(parameter.key, constant)) {
      setParameter(parameter.name, constant, lens, field);
    } else if (field.has()) {
      setParameter(parameter.name, field.number(), lens, field);
    } else if (parameter.is_needed) {
      throw field.error("is missing; a number is expected");
    }
    if (!first) first = field;
  }
  return *first;
}

/// What a coefficient of a model may be.
struct CoefficientRange {
  LensModel model;
  std::size_t place;
  double low;
  double high;
};
constexpr double kLarge = 1e6;
constexpr std::array<CoefficientRange, 6> kRanges = {
    {{LensModel::kFov, 0, 0, 3.14},
     {LensModel::kDoubleSphere, 0, -0.999, 0.999},
     {LensModel::kDoubleSphere, 1, 0, 1},
     {LensModel::kExtendedUnified, 0, 0, 1},
     {LensModel::kExtendedUnified, 1, 1e-6, kLarge},
     {LensModel::kUnified, 0, 0, kLarge}}};

/// Focal lengths, coefficients, and a principal point inside of the image, where its size is known.
void checkLens(const Lens& lens, const Field& field) {
  if (!(lens.fx > 0 && lens.fy > 0)) {
    throw field.error("focal lengths {} {}; expected positive numbers", lens.fx, lens.fy);
  }
  for (const auto& [model, place, low, high] : kRanges) {
    const double value = lens.coefficients.at(place);
    if (model != lens.model || (value >= low && value <= high)) continue;
    const Strings names = splitWords(nameOf(model).coefficient_names);
    throw field.error("{} {}; expected {} to {}", names[place], value, low, high);
  }
  if (lens.width == 0) return;
  if (lens.cx >= 0 && lens.cy >= 0 && lens.cx < lens.width && lens.cy < lens.height) return;
  throw field.error("principal point {} {}; expected inside the image of {}",
                    lens.cx,
                    lens.cy,
                    pixelText(lens.width, lens.height));
}

/// A calibration, once its lens was checked and is of the plainest model that says the same: images
/// without a distortion are not resampled.
/// @param values which may say the readout, too
/// @param field  for complaints
Calibration finished(const KeyedValues& values, const Field& field, Lens lens) {
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
  readReadout(values, lens);
  calibration.lens = lens;
  return calibration;
}

/// One camera of a calibration file.
struct NamedCamera {
  Strings names;  // the first one is that of messages; empty: it has none
  std::function<Calibration()> read;
};

constexpr std::size_t kFolders = 3;  // of a path that may be called as a camera: mav0/cam1/data.csv

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

/// The camera that is called as the choice says, or, where it says nothing or a topic, as the last
/// part of a path that is called as one.
const NamedCamera* find(const std::vector<NamedCamera>& cameras, const CameraChoice& choice) {
  Strings words;
  const std::filesystem::path path =
      choice.name.empty() ? choice.images : std::filesystem::path(choice.name);
  if (!choice.name.empty()) words.push_back(choice.name);
  if (choice.name.empty() || isTopic(choice.name)) {
    const std::vector<std::filesystem::path> parts(path.begin(), path.end());
    const std::size_t count = choice.name.empty() ? std::min(parts.size(), kFolders) : parts.size();
    for (std::size_t i = 1; i <= count; ++i) {
      const std::filesystem::path& part = parts[parts.size() - i];
      words.insert(words.end(), {part.string(), part.stem().string()});
    }
  }
  for (const std::string& word : words) {
    for (const NamedCamera& camera : cameras) {
      if (isCalled(camera, word)) return &camera;
    }
  }
  return nullptr;
}

/// Whether it does not matter which one is meant.
bool areAllSame(const std::vector<NamedCamera>& cameras) {
  const auto numbers = [](const Lens& l) {
    return std::tuple(std::tuple(l.model, l.fx, l.fy, l.cx, l.cy, l.coefficients),
                      std::tuple(l.width, l.height),
                      std::tuple(l.readout.seconds, l.readout.sigma, l.columns));
  };
  try {
    const auto first = numbers(cameras.front().read().lens);
    return std::all_of(cameras.begin() + 1, cameras.end(), [&](const NamedCamera& camera) {
      return numbers(camera.read().lens) == first;
    });
  } catch (const IoError&) {
    return false;
  }
}

std::string listed(const std::vector<NamedCamera>& cameras) {
  Strings list;
  for (const NamedCamera& camera : cameras) {
    list.push_back(camera.names.front());
    if (isTopic(camera.names.back())) list.back() += fmt::format(" ({})", camera.names.back());
  }
  return fmt::format("{}", fmt::join(list, ", "));
}

/// The calibration of the camera that is chosen, or of all where they are the same.
/// @throws IoError that lists them where none is chosen, or one that is not there
Calibration readChosen(const std::filesystem::path& file,
                       const std::vector<NamedCamera>& cameras,
                       const CameraChoice& choice) {
  if (cameras.empty()) throw fileError(file, "has no camera; at least one is expected");
  const bool one = cameras.size() == 1;
  if (one && cameras.front().names.empty()) return cameras.front().read();
  if (const NamedCamera* camera = find(cameras, choice)) return camera->read();
  if (!choice.name.empty() && !(one && isTopic(choice.name))) {
    throw fileError(file,
                    "has no camera '{}'; choose one with --camera: {}",
                    quotable(choice.name),
                    listed(cameras));
  }
  if (one || areAllSame(cameras)) return cameras.front().read();
  throw fileError(file,
                  "has {} cameras, and the images do not say which one took them; choose it with "
                  "--camera: {}",
                  cameras.size(),
                  listed(cameras));
}

// Forms that differ by their keys alone.

/// Where a form has what.
struct Form {
  Strings model;   ///< keys of the words that make up that of a model; none: the first model
  Strings places;  ///< lists for those of the parameters, or groups that their keys may stand in
  LensWords models;
  std::string_view cameras = "";  ///< paths of several cameras, by their numbers; empty: one camera
  std::string_view name = "";     ///< key of a camera's own name, beside cam0, cam1 ...
  std::string_view size = "";     ///< list of width and height; empty: the usual keys, or none
};

constexpr std::string_view kPinholeNumbers = "fx fy cx cy [k1 k2 p1 p2 k3 k4 k5 k6]";
constexpr std::string_view kFisheyeNumbers = "fx fy cx cy [k1 k2 k3 k4]";

// EuRoC's sensor.yaml is one camera of Kalibr's camchain.yaml, with longer names.
/// @source Kalibr's wiki, "Supported models"
const Form kKalibr = {
    {"camera_model", "distortion_model"},
    {"intrinsics", "distortion_coeffs|distortion_coefficients"},
    {{"pinhole radtan|pinhole radial-tangential|pinhole plumb_bob",
      LensModel::kRadTan,
      "fx fy cx cy|k1 k2 p1 p2 [k3]"},
     {"pinhole equidistant", LensModel::kEquidistant, "fx fy cx cy|k1 k2 k3 k4"},
     {"pinhole fov", LensModel::kFov, "fx fy cx cy|omega"},
     {"pinhole none", LensModel::kPinhole, "fx fy cx cy|"},
     {"omni radtan|omni radial-tangential", LensModel::kUnified, "xi fx fy cx cy|k1 k2 p1 p2"},
     {"omni none", LensModel::kUnified, "xi fx fy cx cy|"},
     {"ds none", LensModel::kDoubleSphere, "xi alpha fx fy cx cy|"},
     {"eucm none", LensModel::kExtendedUnified, "alpha beta fx fy cx cy|"}},
    "cam{}",
    "rostopic",
    "resolution"};
// SVO and aslam.
const Form kSvo = {
    {"type", "distortion.type"},
    {"intrinsics", "distortion.parameters"},
    {{"pinhole none", LensModel::kPinhole, "fx fy cx cy|"},
     {"pinhole radial-tangential", LensModel::kRadTan, "fx fy cx cy|[k1 k2 p1 p2 k3]"},
     {"pinhole equidistant", LensModel::kEquidistant, "fx fy cx cy|[k1 k2 k3 k4]"},
     {"pinhole fisheye", LensModel::kFov, "fx fy cx cy|[omega]"}},
    "cameras[{}].camera",
    "label"};
const Form kBasalt = {{"camera_type"},
                      {"intrinsics."},
                      {{"pinhole", LensModel::kPinhole, "fx fy cx cy"},
                       {"pinhole-radtan8", LensModel::kRational, kPinholeNumbers},
                       {"kb4", LensModel::kEquidistant, kFisheyeNumbers},
                       {"fov", LensModel::kFov, "fx fy cx cy [w=omega]"},
                       {"ucm", LensModel::kExtendedUnified, "fx fy cx cy [alpha 1=beta]"},
                       {"eucm", LensModel::kExtendedUnified, "fx fy cx cy [alpha beta]"},
                       {"ds", LensModel::kDoubleSphere, "fx fy cx cy [xi alpha]"}},
                      "value0.intrinsics[{}]",
                      "",
                      "value0.resolution[{}]"};
const Form kVins = {
    {"model_type"},
    {"projection_parameters.", "distortion_parameters.", "mirror_parameters."},
    {{"PINHOLE", LensModel::kRadTan, kPinholeNumbers},
     {"PINHOLE_FULL", LensModel::kRational, "fx fy cx cy [k1 k2 k3 k4 k5 k6 p1 p2]"},
     {"KANNALA_BRANDT",
      LensModel::kEquidistant,
      "mu=fx mv=fy u0=cx v0=cy [k2=k1 k3=k2 k4=k3 k5=k4]"},
     {"MEI", LensModel::kUnified, "gamma1=fx gamma2=fy u0=cx v0=cy [xi k1 k2 p1 p2]"}}};
// ORB-SLAM2 and 3, and stella_vslam, which nests the same keys.
const Form kOrbs = {{"Camera.type|Camera.model"},
                    {"Camera."},
                    {{"PinHole|perspective", LensModel::kRadTan, kPinholeNumbers},
                     {"Rectified", LensModel::kPinhole, "fx fy cx cy"},
                     {"KannalaBrandt8|fisheye", LensModel::kEquidistant, kFisheyeNumbers}}};

/// The model that the words of a form's keys call.
const LensWord& readModel(const KeyedValues& values, const Form& form) {
  std::string words;
  const LensWord* model = &form.models.front();
  for (const std::string& key : form.model) {
    words += (words.empty() ? "" : " ") + values[key].text("a lens model");
    model = &findLens(form.models, words, values[key]);
  }
  return *model;
}

/// @return the first parameter, or the list with the first ones
Field readNumbers(const KeyedValues& values,
                  const Form& form,
                  std::string_view parameters,
                  Lens& lens) {
  if (form.places.front().back() == '.') {
    return readParameters(values, parameters, lens, form.places);
  }
  const Strings lists = io::spellings(parameters);
  for (std::size_t i = 0; i < lists.size(); ++i) {
    setParameters(lists[i], values[form.places[i]].numbers(), lens, values[form.places[i]]);
  }
  return values[form.places.front()];
}

/// The camera of a form.
/// @param lens with its size where that stands elsewhere
Calibration readCamera(const KeyedValues& values, const Form& form, Lens lens = {}) {
  const LensWord& model = readModel(values, form);
  lens.model = model.model;
  if (lens.width == 0 && form.size.empty()) readSize(values, lens);
  if (lens.width == 0 && !form.size.empty()) readSize(values[form.size], lens);
  const Field first = readNumbers(values, form, model.parameters, lens);
  return finished(values, first, lens);
}

std::string numbered(std::string_view path, int number) {
  return fmt::format(fmt::runtime(path), number);
}

/// Whether there are cameras at a form's paths.
bool hasCameras(const KeyedValues& values, const Form& form) {
  for (int i = 0; i < kMaxCameras; ++i) {
    if (values.has(numbered(form.cameras, i))) return true;
  }
  return false;
}

/// One of the cameras of a form.
Calibration readOneOf(const KeyedValues& values, const Form& form, const CameraChoice& choice) {
  std::vector<NamedCamera> cameras;
  const bool sized = form.size.find('{') != std::string_view::npos;
  for (int i = 0; i < kMaxCameras; ++i) {
    const std::string path = numbered(form.cameras, i);
    if (!values.has(path)) continue;
    const KeyedValues camera = values.within(path);
    if (camera.empty()) throw values[path].error("a mapping that describes a camera is expected");
    NamedCamera named{{fmt::format("cam{}", i)}, [&values, camera, &form, sized, i] {
                        Lens lens;
                        if (sized) readSize(values[numbered(form.size, i)], lens);
                        return readCamera(camera, form, lens);
                      }};
    const Field name = camera[form.name];
    if (name.has()) named.names.push_back(name.text("a name"));
    cameras.push_back(std::move(named));
  }
  return readChosen(values.file(), cameras, choice);
}

Calibration readOrbs(const KeyedValues& values, const CameraChoice& choice) {
  for (const char* stereo : {"LEFT.K", "StereoRectifier"}) {
    if (!values.has(stereo)) continue;
    throw values[stereo].error(
        "the numbers of Camera are those of images that this program rectifies for two cameras; "
        "write camera.txt with those of the left or right one");
  }
  const auto read = [&values](const std::string& group) {
    Lens lens;
    readSize(values.within("Camera"), lens);
    Form form = kOrbs;
    form.places = {group + "."};
    if (!values[form.model.front()].has()) form.model.clear();
    return readCamera(values, form, lens);
  };
  std::vector<NamedCamera> cameras;
  for (const Strings& names : {Strings{"Camera1", "cam0", "left"}, {"Camera2", "cam1", "right"}}) {
    const std::string& group = names.front();
    if (values.has(group)) cameras.push_back({names, [read, group] { return read(group); }});
  }
  return cameras.empty() ? read("Camera") : readChosen(values.file(), cameras, choice);
}

// ROS' camera_info (camera_matrix or K, distortion_coefficients or D, distortion_model, binning,
// roi), or what cv::FileStorage wrote.

/// Keys of the matrices of a camera.
struct MatrixKeys {
  std::string_view matrix;
  std::string_view distortion;
  Strings names;  // of the camera
};

const std::array<MatrixKeys, 3> kCameras = {{
    {"camera_matrix|cameraMatrix|Camera_Matrix|K|k",
     "distortion_coefficients|Distortion_Coefficients|distCoeffs|dist_coeffs|D|d",
     {}},
    {"M1|K1|cameraMatrix1|camera_matrix_1",
     "D1|distCoeffs1|dist_coeffs_1",
     {"M1", "cam0", "left", "1"}},
    {"M2|K2|cameraMatrix2|camera_matrix_2",
     "D2|distCoeffs2|dist_coeffs_2",
     {"M2", "cam1", "right", "2"}},
}};

/// fx, fy, cx, cy of a 3x3 matrix, or of a 3x4 one of a rectified camera, whose last column is
/// where it stands.
void readMatrix(const Field& field, std::size_t columns, Lens& lens) {
  const auto m =
      field.numbers(3 * columns, fmt::format("the {} of a 3x{} matrix", 3 * columns, columns));
  const auto at = [&](std::size_t row, std::size_t column) { return m[row * columns + column]; };
  if (at(0, 0) == 0 && at(1, 1) == 0) throw field.error("is 0: nobody has calibrated this camera");
  if (at(0, 1) != 0 || at(1, 0) != 0 || at(2, 0) != 0 || at(2, 1) != 0 || at(2, 2) != 1) {
    throw field.error("expected fx 0 cx, 0 fy cy, 0 0 1 in the first three columns");
  }
  setParameters("fx fy cx cy", {at(0, 0), at(1, 1), at(0, 2), at(1, 2)}, lens, field);
}

/// OpenCV's lens is the rational one, whatever it is called; the numbers that it lacks are 0.
constexpr std::string_view kOpenCv = "[k1 k2 p1 p2 k3 k4 k5 k6 s1 s2 s3 s4 tau_x tau_y]";
const LensWords kRosModels = {
    {"plumb_bob|rational_polynomial|radtan", LensModel::kRational, kOpenCv},
    {"equidistant|fisheye", LensModel::kEquidistant, "[k1 k2 k3 k4 k5 k6 k7 k8]"},
    {"none", LensModel::kPinhole, kOpenCv}};

void readDistortion(const KeyedValues& values, const Field& numbers, Lens& lens) {
  const Field model_field = values["distortion_model"];
  const Field fisheye = values["fisheye_model"];
  const Field omnidir = values["xi"];  // of OpenCV
  std::string word = "plumb_bob";
  if (fisheye.has() && fisheye.number() != 0) {
    word = "fisheye";
  } else if (model_field.has() && !omnidir.has()) {
    word = model_field.text("a word");
  }
  const LensWord& model = findLens(kRosModels, word.empty() ? "none" : word, model_field);
  lens.model = omnidir.has() ? LensModel::kUnified : model.model;
  setParameters(model.parameters, numbers.numbers(), lens, numbers);
  if (omnidir.has()) lens.coefficients[0] = omnidir.number();
}

/// A whole number of at least 0 that may be missing.
double countAt(const Field& field) {
  const double number = field.has() ? field.number() : 0;
  if (number >= 0 && number <= kMaxSize && number == std::floor(number)) return number;
  throw field.error("a whole number is expected, not negative");
}

/// K is that of the whole sensor: the region comes first, then its pixels are added up.
/// @source REP 104 of ROS
void cut(const KeyedValues& values, Calibration& calibration) {
  Lens& lens = calibration.lens;
  const double x = countAt(values["roi.x_offset"]), y = countAt(values["roi.y_offset"]);
  const double width = countAt(values["roi.width"]), height = countAt(values["roi.height"]);
  const double bin_x = std::max(1.0, countAt(values["binning_x"]));
  const double bin_y = std::max(1.0, countAt(values["binning_y"]));
  const double cut_width = width > 0 ? width : lens.width - x;
  const double cut_height = height > 0 ? height : lens.height - y;
  const bool whole = x == 0 && y == 0 && cut_width == lens.width && cut_height == lens.height;
  if (whole && bin_x == 1 && bin_y == 1) return;
  if (lens.width == 0 || x + cut_width > lens.width || y + cut_height > lens.height) {
    throw values["roi.width|binning_x"].error("a region of {} at {} {} is no part of images of {}",
                                              pixelText(cut_width, cut_height),
                                              x,
                                              y,
                                              pixelText(lens.width, lens.height));
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
    const Field matrix = values[keys.matrix];
    if (!matrix.has()) continue;
    cameras.push_back({keys.names, [&values, &keys, matrix] {
                         Lens lens;
                         readSize(values, lens);
                         readMatrix(matrix, 3, lens);
                         readDistortion(values, values[keys.distortion], lens);
                         Calibration calibration = finished(values, matrix, lens);
                         cut(values, calibration);
                         return calibration;
                       }});
    if (keys.names.empty()) break;
  }
  return readChosen(values.file(), cameras, choice);
}

// transforms.json of nerfstudio and instant-ngp.

constexpr std::string_view kNerfNumbers = "[k1 k2 k3 k4 p1 p2]";
const LensWords kNerfModels = {{"OPENCV", LensModel::kRadTan, kNerfNumbers},
                               {"PINHOLE|SIMPLE_PINHOLE", LensModel::kPinhole, kNerfNumbers},
                               {"OPENCV_FISHEYE", LensModel::kEquidistant, kNerfNumbers}};

/// Frames may have a lens each, which must be that of the first one.
void checkFrames(const KeyedValues& values) {
  const std::string keys = "camera_model fl_x fl_y cx cy w h k1 k2 k3 k4 p1 p2";
  for (const std::string& key : splitWords(keys)) {
    const Field all = values[fmt::format("{0}|frames[0].{0}", key)];
    for (int i = 0; values.has(fmt::format("frames[{}]", i)); ++i) {
      const Field own = values[fmt::format("frames[{}].{}", i, key)];
      if (!own.has() || (all.has() && all.text("") == own.text(""))) continue;
      throw own.error("another lens than that of other frames; expected one for all");
    }
  }
}

/// Focal lengths and principal point; instant-ngp may have the field of view [rad] in their place.
void readNerfProjection(const KeyedValues& camera, Lens& lens) {
  const auto size = [&](const char* key, int pixels) {
    if (pixels == 0) throw camera[key].error("is missing; a number of pixels is expected");
    return static_cast<double>(pixels);
  };
  const auto focal = [](double pixels, double angle) { return 0.5 * pixels / std::tan(angle / 2); };
  const auto either = [&](const char* key, double value) {
    return camera[key].has() ? camera[key].number() : value;
  };
  const Field angle_x = camera["camera_angle_x"], angle_y = camera["camera_angle_y"];
  const bool by_angle = !camera["fl_x"].has() && angle_x.has();
  lens.fx = by_angle ? focal(size("w", lens.width), angle_x.number()) : camera["fl_x"].number();
  const bool two_angles = by_angle && angle_y.has();
  lens.fy = either("fl_y", two_angles ? focal(size("h", lens.height), angle_y.number()) : lens.fx);
  lens.cx = (camera["cx"].has() ? camera["cx"].number() : size("w", lens.width) / 2) - kHalfPixel;
  lens.cy = (camera["cy"].has() ? camera["cy"].number() : size("h", lens.height) / 2) - kHalfPixel;
}

Calibration readNerf(const KeyedValues& values) {
  checkFrames(values);
  for (const char* key : {"rolling_shutter", "distortion_params"}) {
    const std::vector<double> numbers = values[key].numbers();
    if (std::all_of(numbers.begin(), numbers.end(), [](double n) { return n == 0; })) continue;
    throw values[key].error("is not read here; expected none, or only zeros");
  }
  const bool of_frames = values["frames[0].fl_x"].has() && !values["fl_x"].has();
  const KeyedValues camera = of_frames ? values.within("frames[0]") : values;
  const Field own = camera["camera_model"];
  const Field model = own.has() ? own : values["camera_model"];
  const Field fisheye = values["is_fisheye"];
  Lens lens;
  lens.model = model.has() ? findLens(kNerfModels, model.text("a lens model"), model).model
               : fisheye.has() && fisheye.text("") == "true" ? LensModel::kEquidistant
                                                             : LensModel::kRadTan;
  readSize(camera, lens);
  readNerfProjection(camera, lens);
  readParameters(camera, kNerfNumbers, lens);
  return finished(values, camera["fl_x"], lens);
}

/// Lens of a YAML, JSON or XML file of any program that is known.
Calibration readKeyed(const KeyedValues& values, const CameraChoice& choice) {
  const bool matrices = std::any_of(kCameras.begin(), kCameras.end(), [&](const MatrixKeys& keys) {
    return values[keys.matrix].has();
  });
  if (matrices) return readMatrices(values, choice);
  if (values["fl_x|camera_angle_x"].has() || values.has("frames[0]")) return readNerf(values);
  for (const Form* form : {&kKalibr, &kSvo, &kBasalt}) {
    if (hasCameras(values, *form)) return readOneOf(values, *form, choice);
  }
  if (values["camera_model"].has()) return readCamera(values, kKalibr);
  if (values.has("Camera") || values.has("Camera1")) return readOrbs(values, choice);
  if (values["model_type"].has()) return readCamera(values, kVins);
  const Field named = values["cam0_calib"];
  if (named.has()) {
    throw named.error("the lens stands in the file that this names; give that one with --calib");
  }
  throw fileError(values.file(),
                  "no calibration that is known here: expected camera_matrix (ROS, OpenCV), "
                  "camera_model (EuRoC, Kalibr), Camera.fx (ORB-SLAM), model_type (VINS) or "
                  "another form of docs/calibration.md");
}

/// First line of camera.txt.
const LensWords kModels = {
    {"Pinhole", LensModel::kPinhole, "fx fy cx cy [omega]"},  // which is 0
    {"FOV", LensModel::kFov, "fx fy cx cy omega"},
    {"RadTan", LensModel::kRadTan, "fx fy cx cy k1 k2 p1 p2 [k3]"},
    {"EquiDistant|KannalaBrandt", LensModel::kEquidistant, "fx fy cx cy k1 k2 k3 k4"},
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
    if (!readout && i >= kLines.size()) throw lines[i].error("more than four lines");
    if (readout) words.erase(words.begin());
    values.add(readout ? "readout" : kLines.at(i), {words, lines[i].number});
  }
  return values;
}

/// First line of camera.txt; without a name its numbers tell the model.
void readModel(const KeyedValues& values, Lens& lens) {
  const Field field = values[kModel];
  if (!field.has()) {
    throw fileError(values.file(), "is empty; expected a camera model, as 'Pinhole fx fy cx cy 0'");
  }
  Strings words = field.content.words;
  double last = 0;
  const bool named = !parseNumber(words.front(), last);
  if (!named && words.size() != 8 && !(words.size() == 5 && parseNumber(words.back(), last))) {
    throw field.error("{} numbers without a name; expected 5 (Pinhole or FOV) or 8 (RadTan)",
                      words.size());
  }
  if (!named)
    words.insert(words.begin(), words.size() == 8 ? "RadTan" : last == 0 ? "Pinhole" : "FOV");
  const LensWord& model = findLens(kModels, words.front(), field);
  Field numbers = field;
  numbers.content.words.assign(words.begin() + 1, words.end());
  lens.model = model.model;
  setParameters(model.parameters, numbers.numbers(), lens, field);
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
void readMode(const Field& field, Rectification& target) {
  const std::string what = "crop, full, none, or relative 'fx fy cx cy 0'";
  const std::string text = field.text(what);
  target.mode = RectificationMode::kCrop;
  if (text == "crop") return;
  target.mode = text == "full" ? RectificationMode::kFull : RectificationMode::kNone;
  if (text == "full" || text == "none") return;
  double number = 0;
  if (!parseNumber(field.content.words.front(), number)) {
    throw field.error("'{}'; expected {}", quotable(text), what);
  }
  const std::vector<double> n = field.numbers(5, what);
  if (!(n[0] > 0 && n[1] > 0 && n[2] >= 0 && n[2] <= 1 && n[3] >= 0 && n[3] <= 1 && n[4] == 0)) {
    throw field.error(
        "'{}'; expected intrinsics relative to the output size: positive focal "
        "lengths, principal point between 0 and 1, and 0 for no distortion",
        quotable(text));
  }
  target.mode = RectificationMode::kExplicit;
  target.camera.fx = n[0];
  target.camera.fy = n[1];
  target.camera.cx = n[2];
  target.camera.cy = n[3];
}

/// camera.txt of DSO.
Calibration readDso(const KeyedValues& values) {
  Lens lens;
  readModel(values, lens);
  readSize(values[kInputSize], lens);
  if (lens.cx < 1 && lens.cy < 1) scaleToPixels(lens.width, lens.height, lens);
  Calibration calibration = finished(values, values[kModel], lens);
  lens = calibration.lens;
  Rectification& target = calibration.rectification;
  const Field output = values[kOutput], size = values[kOutputSize];
  Lens sized = lens;
  if (output.has()) readMode(output, target);
  if (size.has()) readSize(size, sized);
  target.width = sized.width;
  target.height = sized.height;
  if (target.mode == RectificationMode::kExplicit) {
    scaleToPixels(target.width, target.height, target.camera);
  }
  if (target.mode != RectificationMode::kNone) return calibration;
  if (isDistorted(lens)) {
    throw output.error(
        "'none' would leave the distortion of the {} lens of line 1 in the images; "
        "expected crop or full. Of images that are undistorted already, line 1 is "
        "'Pinhole fx fy cx cy 0'",
        nameOf(lens.model).name);
  }
  if (target.width != lens.width || target.height != lens.height) {
    throw size.error("'none' cannot turn {} into {}; expected equal sizes, or crop",
                     pixelText(lens.width, lens.height),
                     pixelText(target.width, target.height));
  }
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

/// Both kinds of images have the calibration of their size; most recordings are rectified.
Calibration readRaw(const KeyedValues& values, const std::string& number, const CameraChoice& c) {
  Lens raw{LensModel::kRadTan};
  Lens rectified;
  const Field raw_size = values["S_" + number], rectified_size = values["S_rect_" + number];
  if (raw_size.has()) readSize(raw_size, raw);
  if (rectified_size.has()) readSize(rectified_size, rectified);
  const auto fits = [&](const Lens& l) { return l.width == c.width && l.height == c.height; };
  const Field projection = values["P_rect_" + number], matrix = values["K_" + number];
  if (projection.has() && (fits(rectified) || !fits(raw))) {
    readMatrix(projection, 4, rectified);
    return finished(values, projection, rectified);
  }
  readMatrix(matrix, 3, raw);
  const Field distortion = values["D_" + number];
  setParameters("k1 k2 p1 p2 k3", distortion.numbers(), raw, distortion);
  return finished(values, matrix, raw);
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
  for (const std::string number : {"0", "1", "2", "3"}) {
    const Field projection = values["P" + number];
    const std::string two = "0" + number;
    if (projection.has()) {
      cameras.push_back({{"image_" + number, "P" + number, number}, [&values, projection] {
                           Lens lens;
                           readMatrix(projection, 4, lens);
                           return finished(values, projection, lens);
                         }});
    } else if (values[fmt::format("P_rect_{0}|K_{0}", two)].has()) {
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

/// Lines of a number, a name in capitals, and more.
bool isColmap(const std::vector<TextLine>& lines) {
  if (lines.empty()) return false;
  const Strings words = splitWords(lines.front().text);
  double id = 0;
  return words.size() > 2 && parseNumber(words[0], id) && words[1].size() > 2 &&
         std::isupper(static_cast<unsigned char>(words[1].front())) != 0 &&
         words[1].find_first_not_of("ABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_") == std::string::npos;
}

/// A line "ID MODEL width height ..." of COLMAP, whose pixels have their centres at .5.
Calibration readColmapCamera(const std::filesystem::path& file, const TextLine& line) {
  const Strings words = splitWords(line.text);
  if (words.size() < 4) throw line.error("expected 'ID MODEL width height ...'");
  const Field field{file, "", {{words.begin() + 2, words.end()}, line.number}};
  const LensWord& model = findLens(kColmapModels, words[1], field);
  std::vector<double> numbers = field.numbers();
  Lens lens{model.model};
  setSize(numbers[0], numbers[1], lens, field);
  numbers.erase(numbers.begin(), numbers.begin() + 2);
  setParameters(model.parameters, numbers, lens, field);
  lens.cx -= kHalfPixel;
  lens.cy -= kHalfPixel;
  return finished(KeyedValues(file), field, lens);
}

Calibration readColmap(const std::filesystem::path& file,
                       const std::vector<TextLine>& lines,
                       const CameraChoice& choice) {
  std::vector<NamedCamera> cameras;
  cameras.reserve(lines.size());
  for (const TextLine& line : lines) {
    cameras.push_back(
        {{splitWords(line.text).front()}, [&] { return readColmapCamera(file, line); }});
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
