// SPDX-License-Identifier: BSD-3-Clause
#include "io/calibration_colmap.h"

#include "io/lens_numbers.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <string>
#include <string_view>

namespace dsorb {
namespace {

/// A camera model of COLMAP, its parameters by name.
/// @source COLMAP's documentation, "Camera Models"
struct ColmapModel {
  std::string_view name;
  LensModel model;
  const char* parameters;  // as COLMAP orders them
};

constexpr std::array<ColmapModel, 10> kModels = {{
    {"SIMPLE_PINHOLE", LensModel::kPinhole, "f cx cy"},
    {"PINHOLE", LensModel::kPinhole, "fx fy cx cy"},
    {"SIMPLE_RADIAL", LensModel::kRadTan, "f cx cy k1"},
    {"RADIAL", LensModel::kRadTan, "f cx cy k1 k2"},
    {"OPENCV", LensModel::kRadTan, "fx fy cx cy k1 k2 p1 p2"},
    {"FULL_OPENCV", LensModel::kRadTan, "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"},
    {"OPENCV_FISHEYE", LensModel::kEquidistant, "fx fy cx cy k1 k2 k3 k4"},
    {"SIMPLE_RADIAL_FISHEYE", LensModel::kEquidistant, "f cx cy k1"},
    {"RADIAL_FISHEYE", LensModel::kEquidistant, "f cx cy k1 k2"},
    {"FOV", LensModel::kFov, "fx fy cx cy omega"},
}};

const ColmapModel& modelOf(const std::filesystem::path& file, int line, const std::string& word) {
  const auto* model = std::find_if(
      kModels.begin(), kModels.end(), [&](const ColmapModel& m) { return m.name == word; });
  if (model != kModels.end()) return *model;
  std::string known;
  for (const ColmapModel& m : kModels) known += (known.empty() ? "" : ", ") + std::string(m.name);
  throw lineError(
      file,
      line,
      fmt::format("the camera model {} is not known here; expected {}", quotable(word), known));
}

}  // namespace

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

Calibration readColmap(const std::filesystem::path& file, const std::vector<TextLine>& lines) {
  if (lines.size() != 1) {
    throw lineError(
        file,
        lines[1].number,
        fmt::format("{} cameras; expected one, leave the line of the one that took the images",
                    lines.size()));
  }
  const int line = lines.front().number;
  std::vector<std::string> words = splitWords(lines.front().text);
  const ColmapModel& model = modelOf(file, line, words[1]);
  const std::vector<std::string> names = splitWords(model.parameters);
  words.erase(words.begin(), words.begin() + 2);
  const std::string expectation =
      fmt::format("ID {} width height {}", model.name, model.parameters);
  const std::vector<double> numbers = parseNumbers(file, line, words, expectation);
  if (numbers.size() != names.size() + 2) {
    throw lineError(
        file,
        line,
        fmt::format("{} numbers after the model; expected '{}'", numbers.size(), expectation));
  }
  Calibration calibration;
  Lens& lens = calibration.lens;
  const auto complain = [&](const std::string& what) { return lineError(file, line, what); };
  lens.model = model.model;
  setSize(numbers[0], numbers[1], lens, complain);
  std::vector<double> coefficients;
  for (std::size_t i = 0; i < names.size(); ++i) {
    const double value = numbers[i + 2];
    if (names[i] == "f") lens.fx = lens.fy = value;
    if (names[i] == "fx") lens.fx = value;
    if (names[i] == "fy") lens.fy = value;
    if (names[i] == "cx") lens.cx = value - 0.5;
    if (names[i] == "cy") lens.cy = value - 0.5;
    if (names[i][0] == 'k' || names[i][0] == 'p' || names[i] == "omega") {
      coefficients.push_back(value);
    }
  }
  setCoefficients(coefficients, lens, complain);
  checkLens(lens, complain);
  if (lens.model == LensModel::kPinhole) calibration.rectification.mode = RectificationMode::kNone;
  return calibration;
}

}  // namespace dsorb
