// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/io/calibration_reader.h"

#include "camera/lens_models.h"
#include "io/calibration/lens_numbers.h"
#include "io/text_file.h"

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

// Limits of JSON, which may hold the poses of many images.
constexpr std::size_t kMaxJsonBytes = std::size_t{1} << 23;
constexpr std::size_t kMaxJsonValues = 400000;

/// First line of camera.txt.
const std::vector<LensWord> kModels = {
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
    std::vector<std::string> words = splitWords(lines[i].text);
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
  std::vector<std::string> words = splitWords(values.text(kModel, ""));
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
  const LensWord& model = findLens(kModels, words.front(), values.complain(kModel));
  words.erase(words.begin());
  KeyedValues numbers(values.file());
  numbers.add(kModel, {words, values.all().at(kModel).line});
  lens.model = model.model;
  setParameters(model.parameters, numbers.numbers(kModel), lens, numbers.complain(kModel));
}

/// Relative intrinsics let pixel (0, 0) cover [0, 1]; ours has its centre at (0, 0).
/// @tparam Camera with members fx, fy, cx, cy
template <typename Camera>
void scaleToPixels(int width, int height, Camera& camera) {
  camera.fx *= width;
  camera.fy *= height;
  camera.cx = camera.cx * width - 0.5;
  camera.cy = camera.cy * height - 0.5;
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
  if (values.has(kOutputSize)) readSize(values, kOutputSize, output);
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
  readSize(values, kInputSize, lens);
  if (lens.cx < 1 && lens.cy < 1) scaleToPixels(lens.width, lens.height, lens);
  Calibration calibration = finished(values, kModel, lens);
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
  setParameters(
      "fx fy cx cy", {at(0, 0), at(1, 1), at(0, 2), at(1, 2)}, lens, values.complain(key));
}

/// Both kinds of images have the calibration of their size; most recordings are rectified.
Calibration readRaw(const KeyedValues& values, const std::string& number, const CameraChoice& c) {
  Lens raw;
  Lens rectified;
  const std::string raw_size = "S_" + number, rectified_size = "S_rect_" + number;
  if (values.has(raw_size)) readSize(values, raw_size, raw);
  if (values.has(rectified_size)) readSize(values, rectified_size, rectified);
  const auto fits = [&](const Lens& l) { return l.width == c.width && l.height == c.height; };
  const std::string projection = "P_rect_" + number, matrix = "K_" + number;
  if (values.has(projection) && (fits(rectified) || !fits(raw))) {
    readProjection(values, projection, rectified);
    return finished(values, projection, rectified);
  }
  readProjection(values, matrix, raw);
  raw.model = LensModel::kRadTan;
  const std::string distortion = "D_" + number;
  setParameters("k1 k2 p1 p2 k3", values.numbers(distortion), raw, values.complain(distortion));
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
  for (const char number : {'0', '1', '2', '3'}) {
    const std::string projection = std::string("P") + number;
    const std::string two = std::string("0") + number;
    if (values.has(projection)) {
      cameras.push_back({{std::string("image_") + number, projection, std::string(1, number)},
                         [&values, projection] {
                           Lens lens;
                           readProjection(values, projection, lens);
                           return finished(values, projection, lens);
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
const std::vector<LensWord> kColmapModels = {
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

Calibration readColmapCamera(const TextLine& line) {
  const auto complain = [&](const std::string& what) { return line.error(what); };
  std::vector<std::string> words = splitWords(line.text);
  if (words.size() < 4) throw line.error("expected 'ID MODEL width height ...'");
  const LensWord& model = findLens(kColmapModels, words[1], complain);
  words.erase(words.begin(), words.begin() + 2);
  const std::vector<double> numbers =
      line.numbers(words, fmt::format("ID {} width height {}", model.word, model.parameters));
  Lens lens;
  lens.model = model.model;
  setSize(numbers[0], numbers[1], lens, complain);
  setParameters(model.parameters, {numbers.begin() + 2, numbers.end()}, lens, complain);
  lens.cx -= 0.5;  // pixels have their centres at .5
  lens.cy -= 0.5;
  return finished(lens, complain);
}

/// Lines of a number, a name in capitals, and more.
bool isColmap(const std::vector<TextLine>& lines) {
  if (lines.empty()) return false;
  const std::vector<std::string> words = splitWords(lines.front().text);
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
  for (const TextLine& line : lines) {
    cameras.push_back(
        {{splitWords(line.text).front()}, [&line] { return readColmapCamera(line); }});
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
