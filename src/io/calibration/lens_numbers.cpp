// SPDX-License-Identifier: BSD-3-Clause
#include "io/calibration/lens_numbers.h"

#include "camera/lens_models.h"

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <strings.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <optional>
#include <tuple>
#include <utility>

namespace dsorb {
namespace {

/// Checks the numbers of lenses that project by an angle, a sphere or an ellipsoid.
void checkCoefficients(const Lens& lens, const Complain& complain) {
  const auto [a, b] = std::pair(lens.coefficients[0], lens.coefficients[1]);
  if (lens.model == LensModel::kFov && !(a >= 0 && a < M_PI)) {
    throw complain(fmt::format("omega {}; expected 0 <= omega < pi", a));
  }
  if (lens.model == LensModel::kDoubleSphere && !(a > -1 && a < 1 && b >= 0 && b <= 1)) {
    throw complain(fmt::format("xi {}, alpha {}; expected -1 < xi < 1 and 0 <= alpha <= 1", a, b));
  }
  if (lens.model == LensModel::kExtendedUnified && !(a >= 0 && a <= 1 && b > 0)) {
    throw complain(fmt::format("alpha {}, beta {}; expected 0 <= alpha <= 1 and beta > 0", a, b));
  }
  if (lens.model == LensModel::kUnified && !(a >= 0)) {
    throw complain(fmt::format("xi {}; expected at least 0", a));
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

}  // namespace

const LensWord& findLens(const std::vector<LensWord>& models,
                         const std::string& word,
                         const Complain& complain) {
  std::string known;
  for (const LensWord& model : models) {
    if (strcasecmp(std::string(model.word).c_str(), word.c_str()) == 0) return model;
    known += fmt::format("{}{}", known.empty() ? "" : ", ", model.word);
  }
  throw complain(
      fmt::format("'{}' is no lens model that is known here; expected {}. Where the lens can be "
                  "calibrated with one of docs/calibration.md, write that as camera.txt",
                  quotable(word),
                  known));
}

bool setReadout(std::string_view text, Lens& lens) {
  const std::vector<std::string> words = splitWords(text);
  const bool columns = words.size() == 2 && words.back() == "columns";
  if (words.size() != 1 && !columns) return false;
  const std::optional<Readout> readout = parseReadout(words.front());
  if (!readout) return false;
  lens.readout = *readout;
  lens.columns = columns;
  return true;
}

void setSize(double width, double height, Lens& lens, const Complain& complain) {
  for (const double size : {width, height}) {
    if (!(size >= 1 && size <= kMaxSize) || size != std::floor(size)) {
      throw complain(
          fmt::format("image size {}x{}; expected positive whole numbers", width, height));
    }
  }
  lens.width = static_cast<int>(width);
  lens.height = static_cast<int>(height);
}

void readSize(const io::KeyedValues& values, Lens& lens) {
  const std::string width = values.find({"image_width", "image_Width", "width", "cols", "w"});
  const std::string height = values.find({"image_height", "image_Height", "height", "rows", "h"});
  if (width.empty() && height.empty()) return;
  if (width.empty() || height.empty()) {
    throw values.error(width + height, "width and height of the images are expected together");
  }
  setSize(values.number(width), values.number(height), lens, values.complain(width));
}

void readSize(const io::KeyedValues& values, const std::string& key, Lens& lens) {
  const auto size = values.numbers(key, 2, "width, height");
  setSize(size[0], size[1], lens, values.complain(key));
}

void setParameter(std::string_view name, double value, Lens& lens, const Complain& complain) {
  if (name == "f") lens.fx = lens.fy = value;
  const std::array<std::pair<std::string_view, double*>, 4> plain = {
      {{"fx", &lens.fx}, {"fy", &lens.fy}, {"cx", &lens.cx}, {"cy", &lens.cy}}};
  for (const auto& [own, number] : plain) {
    if (name == own) *number = value;
  }
  if (name.front() == 'f' || name.front() == 'c') return;
  const LensModelName& model = nameOf(lens.model);
  const std::vector<std::string> names = splitWords(model.coefficient_names);
  const auto place = std::find(names.begin(), names.end(), name);
  if (place != names.end()) {
    lens.coefficients[static_cast<std::size_t>(place - names.begin())] = value;
  } else if (value != 0) {
    throw complain(
        fmt::format("the distortion coefficient {} is {}, which lenses of the model {} "
                    "do not have here ({}); calibrate without it, or with a model of "
                    "docs/calibration.md",
                    name,
                    value,
                    model.name,
                    names.empty() ? "no distortion" : model.coefficient_names));
  }
}

void setParameters(std::string_view list,
                   const std::vector<double>& values,
                   Lens& lens,
                   const Complain& complain) {
  const std::vector<Parameter> parameters = parametersOf(list);
  const bool too_few = values.size() < parameters.size() && parameters[values.size()].is_needed;
  if (values.size() > parameters.size() || too_few) {
    throw complain(fmt::format("{} numbers; expected '{}'", values.size(), list));
  }
  for (std::size_t i = 0; i < values.size(); ++i) {
    setParameter(parameters[i].name, values[i], lens, complain);
  }
}

std::string readParameters(const io::KeyedValues& values,
                           std::string_view list,
                           Lens& lens,
                           const std::vector<std::string>& groups) {
  std::string first;
  for (const Parameter& parameter : parametersOf(list)) {
    std::vector<std::string> keys;
    for (const std::string& group : groups) keys.push_back(group + parameter.key);
    const std::string key = values.find(keys);
    if (first.empty()) first = key;
    if (!key.empty()) setParameter(parameter.name, values.number(key), lens, values.complain(key));
    if (key.empty() && parameter.is_needed) {
      throw values.error(keys.front(), "is missing; a number is expected");
    }
  }
  return first;
}

void checkLens(const Lens& lens, const Complain& complain) {
  if (!(lens.fx > 0 && lens.fy > 0)) {
    throw complain(fmt::format("focal lengths {} {}; expected positive numbers", lens.fx, lens.fy));
  }
  checkCoefficients(lens, complain);
  if (lens.width == 0) return;
  if (lens.cx >= 0 && lens.cy >= 0 && lens.cx < lens.width && lens.cy < lens.height) return;
  throw complain(fmt::format("principal point {} {}; expected inside the image of {}",
                             lens.cx,
                             lens.cy,
                             pixelText(lens.width, lens.height)));
}

Calibration finished(Lens lens, const Complain& complain) {
  checkLens(lens, complain);
  const auto& k = lens.coefficients;
  if (lens.model == LensModel::kRational && k[5] == 0 && k[6] == 0 && k[7] == 0) {
    lens.model = LensModel::kRadTan;
  }
  Calibration calibration;
  if (!isDistorted(lens)) {
    lens.model = LensModel::kPinhole;
    calibration.rectification.mode = RectificationMode::kNone;
  }
  calibration.lens = lens;
  return calibration;
}

Calibration finished(const io::KeyedValues& values, const std::string& key, const Lens& lens) {
  Calibration calibration = finished(lens, values.complain(key));
  if (values.has(kReadoutKey) &&
      !setReadout(values.text(kReadoutKey, kReadoutForm), calibration.lens)) {
    throw values.error(kReadoutKey, fmt::format("{} are expected", kReadoutForm));
  }
  return calibration;
}

namespace {

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
    return std::tuple(l.model, l.fx, l.fy, l.cx, l.cy, l.coefficients, l.width, l.height);
  };
  return numbers(a.lens) == numbers(b.lens) && a.lens.readout.seconds == b.lens.readout.seconds &&
         a.lens.readout.sigma == b.lens.readout.sigma && a.lens.columns == b.lens.columns;
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

}  // namespace

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

}  // namespace dsorb
