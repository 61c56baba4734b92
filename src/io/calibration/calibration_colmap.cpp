// SPDX-License-Identifier: BSD-3-Clause
#include "io/calibration/calibration_forms.h"
#include "io/calibration/camera_choice.h"
#include "io/calibration/lens_numbers.h"

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
    {"FULL_OPENCV", LensModel::kRational, "fx fy cx cy k1 k2 p1 p2 k3 k4 k5 k6"},
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

Calibration readCamera(const std::filesystem::path& file, const TextLine& text) {
  const int line = text.number;
  std::vector<std::string> words = splitWords(text.text);
  if (words.size() < 2) throw lineError(file, line, "expected 'ID MODEL width height ...'");
  const ColmapModel& model = modelOf(file, line, words[1]);
  words.erase(words.begin(), words.begin() + 2);
  const std::string expectation =
      fmt::format("ID {} width height {}", model.name, model.parameters);
  const std::vector<double> numbers = parseNumbers(file, line, words, expectation);
  if (numbers.size() != splitWords(model.parameters).size() + 2) {
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
  setParameters(model.parameters, {numbers.begin() + 2, numbers.end()}, lens, complain);
  lens.cx -= 0.5;
  lens.cy -= 0.5;
  checkLens(lens, complain);
  simplify(calibration);
  return calibration;
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

Calibration readColmap(const std::filesystem::path& file,
                       const std::vector<TextLine>& lines,
                       const CameraChoice& choice) {
  std::vector<NamedCamera> cameras;
  for (const TextLine& line : lines) {
    cameras.push_back(
        {{splitWords(line.text).front()}, [&file, &line] { return readCamera(file, line); }});
  }
  return readChosen(file, cameras, choice);
}

}  // namespace dsorb
