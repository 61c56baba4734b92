// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/io/calibration_reader.h"

#include "camera/lens_models.h"
#include "io/calibration/calibration_forms.h"
#include "io/calibration/keyed_values.h"
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

constexpr std::string_view kReadoutWord = "readout";

/// One way to write the first line of camera.txt.
struct LensForm {
  std::string_view word;
  LensModel model;
  std::size_t least_numbers;  // after the word
  std::size_t most_numbers;
  const char* expectation;
};

constexpr std::array<LensForm, 9> kLensForms = {{
    {"Pinhole", LensModel::kPinhole, 4, 5, "Pinhole fx fy cx cy 0"},
    {"FOV", LensModel::kFov, 5, 5, "FOV fx fy cx cy omega"},
    {"RadTan", LensModel::kRadTan, 8, 9, "RadTan fx fy cx cy k1 k2 p1 p2 [k3]"},
    {"EquiDistant", LensModel::kEquidistant, 8, 8, "EquiDistant fx fy cx cy k1 k2 k3 k4"},
    {"KannalaBrandt", LensModel::kEquidistant, 8, 8, "KannalaBrandt fx fy cx cy k1 k2 k3 k4"},
    {"Rational", LensModel::kRational, 12, 12, "Rational fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"},
    {"DoubleSphere", LensModel::kDoubleSphere, 6, 6, "DoubleSphere fx fy cx cy xi alpha"},
    {"EUCM", LensModel::kExtendedUnified, 6, 6, "EUCM fx fy cx cy alpha beta"},
    {"Unified", LensModel::kUnified, 5, 9, "Unified fx fy cx cy xi [k1 k2 p1 p2]"},
}};

/// Text file of a calibration, line by line.
class Lines {
 public:
  explicit Lines(const std::filesystem::path& file)
      : file_(file), lines_(readLines(file, kMaxCalibrationBytes)) {}

  [[nodiscard]] const std::filesystem::path& file() const { return file_; }
  [[nodiscard]] const std::vector<TextLine>& all() const { return lines_; }
  void dropLast() { lines_.pop_back(); }
  [[nodiscard]] bool has(std::size_t i) const { return i < lines_.size(); }
  [[nodiscard]] const std::string& text(std::size_t i) const { return lines_[i].text; }
  [[nodiscard]] IoError error(std::size_t i, const std::string& what) const {
    return lineError(file_, has(i) ? lines_[i].number : 0, what);
  }
  [[nodiscard]] std::vector<double> numbers(std::size_t i,
                                            const std::vector<std::string>& words,
                                            const std::string& what) const {
    return parseNumbers(file_, lines_[i].number, words, what);
  }

 private:
  std::filesystem::path file_;
  std::vector<TextLine> lines_;
};

struct Size {
  int width;
  int height;
};

Size readSize(const Lines& lines, std::size_t i, const std::string& what) {
  if (!lines.has(i)) throw lines.error(i, fmt::format("ends before '{}'", what));
  const auto numbers = lines.numbers(i, splitWords(lines.text(i)), what);
  const bool good =
      numbers.size() == 2 && std::all_of(numbers.begin(), numbers.end(), [](double n) {
        return n >= 1 && n <= kMaxSize && n == std::floor(n);
      });
  if (!good) {
    throw lines.error(
        i,
        fmt::format(
            "'{}'; expected '{}', two positive whole numbers", quotable(lines.text(i)), what));
  }
  return {static_cast<int>(numbers[0]), static_cast<int>(numbers[1])};
}

/// Model of a line without a name, told by its numbers.
LensModel legacyModel(const Lines& lines, const std::vector<double>& numbers) {
  if (numbers.size() == 8) return LensModel::kRadTan;
  if (numbers.size() == 5) return numbers[4] == 0 ? LensModel::kPinhole : LensModel::kFov;
  throw lines.error(
      0,
      fmt::format("{} numbers without a model; expected 5 (Pinhole or FOV) or 8 (RadTan)",
                  numbers.size()));
}

/// First line of camera.txt. @return model and its numbers as written
std::pair<LensModel, std::vector<double>> readLensLine(const Lines& lines) {
  if (!lines.has(0)) {
    throw lines.error(0, "is empty; expected a camera model, for example 'Pinhole fx fy cx cy 0'");
  }
  std::vector<std::string> words = splitWords(lines.text(0));
  double first = 0;
  if (parseNumber(words.front(), first)) {
    const auto numbers = lines.numbers(0, words, "numbers");
    return {legacyModel(lines, numbers), numbers};
  }
  const auto* form = std::find_if(kLensForms.begin(), kLensForms.end(), [&](const LensForm& f) {
    return words.front() == f.word;
  });
  if (form == kLensForms.end()) {
    throw lines.error(0,
                      fmt::format("'{}' is no camera model; expected Pinhole, FOV, RadTan, "
                                  "EquiDistant, KannalaBrandt, Rational, DoubleSphere, EUCM, "
                                  "Unified, or 5 or 8 numbers",
                                  quotable(words.front())));
  }
  words.erase(words.begin());
  const auto numbers = lines.numbers(0, words, form->expectation);
  if (numbers.size() < form->least_numbers || numbers.size() > form->most_numbers) {
    throw lines.error(0,
                      fmt::format("{} numbers; expected '{}'", numbers.size(), form->expectation));
  }
  return {form->model, numbers};
}

/// Relative intrinsics let pixel (0, 0) cover [0, 1]; ours has its centre at (0, 0).
/// @tparam Camera with members fx, fy, cx, cy
template <typename Camera>
void scaleToPixels(Size size, Camera& camera) {
  camera.fx *= size.width;
  camera.fy *= size.height;
  camera.cx = camera.cx * size.width - 0.5;
  camera.cy = camera.cy * size.height - 0.5;
}

Lens readLens(const Lines& lines) {
  const auto [model, numbers] = readLensLine(lines);
  const Size size = readSize(lines, 1, "input width and height");
  Lens lens;
  lens.model = model;
  lens.fx = numbers[0];
  lens.fy = numbers[1];
  lens.cx = numbers[2];
  lens.cy = numbers[3];
  lens.width = size.width;
  lens.height = size.height;
  if (model != LensModel::kPinhole) {
    std::copy(numbers.begin() + 4, numbers.end(), lens.coefficients.begin());
  } else if (numbers.size() > 4 && numbers[4] != 0) {
    throw lines.error(0,
                      fmt::format("{} behind cy: a Pinhole has no distortion; expected 0, or 'FOV "
                                  "fx fy cx cy omega'",
                                  numbers[4]));
  }
  if (lens.cx < 1 && lens.cy < 1) scaleToPixels(size, lens);
  checkLens(lens, [&](const std::string& what) { return lines.error(0, what); });
  return lens;
}

/// Third line: a word, or the relative intrinsics of the output camera.
void readMode(const Lines& lines, Rectification& target) {
  const std::string& text = lines.text(2);
  if (text == "crop") {
    target.mode = RectificationMode::kCrop;
  } else if (text == "full") {
    target.mode = RectificationMode::kFull;
  } else if (text == "none") {
    target.mode = RectificationMode::kNone;
  } else {
    const std::string what = "crop, full, none, or relative 'fx fy cx cy 0'";
    const auto numbers = lines.numbers(2, splitWords(text), what);
    if (numbers.size() != 5) {
      throw lines.error(2, fmt::format("{} numbers; expected {}", numbers.size(), what));
    }
    const bool good = numbers[0] > 0 && numbers[1] > 0 && numbers[2] >= 0 && numbers[2] <= 1 &&
                      numbers[3] >= 0 && numbers[3] <= 1 && numbers[4] == 0;
    if (!good) {
      throw lines.error(2,
                        fmt::format("'{}'; expected output intrinsics relative to the output size: "
                                    "positive focal lengths, principal point between 0 and 1, "
                                    "and 0 for no distortion",
                                    quotable(text)));
    }
    target.mode = RectificationMode::kExplicit;
    target.camera.fx = numbers[0];
    target.camera.fy = numbers[1];
    target.camera.cx = numbers[2];
    target.camera.cy = numbers[3];
  }
}

/// Last line: "readout", and what setReadout() reads.
void readReadout(const Lines& lines, Lens& lens) {
  const std::size_t last = lines.all().size() - 1;
  const std::string& line = lines.text(last);
  if (!setReadout(line.substr(kReadoutWord.size()), lens)) {
    throw lines.error(
        last, fmt::format("'{}'; behind 'readout' {} are expected", quotable(line), kReadoutForm));
  }
}

Rectification readRectification(const Lines& lines, const Lens& lens) {
  Rectification target;
  target.width = lens.width;
  target.height = lens.height;
  if (!lines.has(2)) {
    if (lens.model == LensModel::kPinhole) target.mode = RectificationMode::kNone;
    return target;
  }
  readMode(lines, target);
  if (lines.has(3)) {
    const Size size = readSize(lines, 3, "output width and height");
    target.width = size.width;
    target.height = size.height;
  }
  if (target.mode == RectificationMode::kNone && isDistorted(lens)) {
    throw lines.error(2,
                      fmt::format("'none' would leave the distortion of the {} lens of line 1 in "
                                  "the images; expected crop or full. Of images that are "
                                  "undistorted already, line 1 is 'Pinhole fx fy cx cy 0'",
                                  nameOf(lens.model).name));
  }
  if (target.mode == RectificationMode::kNone &&
      (target.width != lens.width || target.height != lens.height)) {
    throw lines.error(
        3,
        fmt::format("'none' cannot turn {}x{} into {}x{} px; expected equal sizes, or crop",
                    lens.width,
                    lens.height,
                    target.width,
                    target.height));
  }
  if (target.mode == RectificationMode::kExplicit) {
    scaleToPixels({target.width, target.height}, target.camera);
  }
  if (lines.has(4)) throw lines.error(4, "more than four lines");
  return target;
}

/// camera.txt of DSO.
Calibration readDso(Lines lines) {
  Calibration calibration;
  const bool rolling = lines.has(1) && splitWords(lines.all().back().text).front() == kReadoutWord;
  Lens timed;
  if (rolling) {
    readReadout(lines, timed);
    lines.dropLast();
  }
  calibration.lens = readLens(lines);
  calibration.lens.readout = timed.readout;
  calibration.lens.columns = timed.columns;
  calibration.rectification = readRectification(lines, calibration.lens);
  return calibration;
}

Calibration readKeyed(const io::KeyedValues& values, const CameraChoice& choice) {
  if (hasCameraMatrix(values)) return readMatrices(values, choice);
  const bool nerf = values.has("fl_x") || values.hasPath("frames[0]");
  if (isKalibr(values) && !nerf) return readKalibr(values, choice);
  return readSettings(values, choice);
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
    return readKeyed(io::yamlValues(file, io::kPlainLimits), choice);
  }
  if (suffix == ".json") return readKeyed(io::yamlValues(file, io::kJsonLimits), choice);
  if (suffix == ".xml") {
    return readKeyed(io::xmlValues(file, readText(file, kMaxCalibrationBytes)), choice);
  }
  const Lines lines(file);
  if (isKitti(lines.all())) return readKitti(file, lines.all(), choice);
  if (isColmap(lines.all())) return readColmap(file, lines.all(), choice);
  return readDso(lines);
}

}  // namespace dsorb
