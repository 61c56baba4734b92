// SPDX-License-Identifier: BSD-3-Clause
#include "io/calibration_matrix.h"

#include "io/lens_numbers.h"
#include "io/text_file.h"

#include <fmt/format.h>
#include <tinyxml2.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <map>
#include <vector>

namespace dsorb {
namespace {

constexpr std::size_t kMaxNumbers = 64;  // of a matrix; none that is read has more than 14

using Keys = std::vector<const char*>;

/// A value of the file: numbers of a scalar, list or matrix, or words.
struct Value {
  std::vector<double> numbers;
  std::string word;
  int line = 0;
};

/// Values by key; every complaint names file, line and key.
class Values {
 public:
  explicit Values(const std::filesystem::path& file) : file_(file) {}
  void add(const std::string& key, Value value) { values_[key] = std::move(value); }

  /// The key among several spellings that the file has; empty: none.
  [[nodiscard]] std::string find(const Keys& spellings) const {
    for (const char* key : spellings) {
      if (values_.count(key) > 0) return key;
    }
    return {};
  }
  [[nodiscard]] const Value& at(const std::string& key) const { return values_.at(key); }
  [[nodiscard]] double number(const std::string& key) const {
    if (at(key).numbers.size() != 1) throw error(key, "a number is expected");
    return at(key).numbers.front();
  }
  [[nodiscard]] IoError error(const std::string& key, const std::string& what) const {
    const auto value = values_.find(key);
    return lineError(file_,
                     value == values_.end() ? 0 : value->second.line,
                     key.empty() ? what : fmt::format("{}: {}", key, what));
  }

 private:
  std::filesystem::path file_;
  std::map<std::string, Value> values_;
};

const Keys kMatrixKeys = {"camera_matrix", "cameraMatrix", "Camera_Matrix", "K", "k", "M1"};
const Keys kDistortionKeys = {"distortion_coefficients",
                              "Distortion_Coefficients",
                              "distCoeffs",
                              "dist_coeffs",
                              "D",
                              "d",
                              "D1"};
const Keys kWidthKeys = {"image_width", "image_Width", "width"};
const Keys kHeightKeys = {"image_height", "image_Height", "height"};
const Keys kModelKeys = {"distortion_model", "fisheye_model"};
const Keys kReadoutKeys = {kReadoutKey};

void readMatrixSize(const Values& values, Lens& lens) {
  const std::string width = values.find(kWidthKeys);
  const std::string height = values.find(kHeightKeys);
  if (width.empty() && height.empty()) return;
  if (width.empty() || height.empty()) {
    throw values.error("", "image_width and image_height are expected together");
  }
  setSize(values.number(width), values.number(height), lens, [&](const std::string& what) {
    return values.error(width, what);
  });
}

void readMatrix(const Values& values, const std::string& key, Lens& lens) {
  const std::vector<double>& k = values.at(key).numbers;
  if (k.size() != 9) {
    throw values.error(key, fmt::format("{} numbers; expected the 9 of a 3x3 matrix", k.size()));
  }
  if (k[1] != 0 || k[3] != 0 || k[6] != 0 || k[7] != 0 || k[8] != 1) {
    throw values.error(key, "expected fx 0 cx, 0 fy cy, 0 0 1");
  }
  lens.fx = k[0];
  lens.cx = k[2];
  lens.fy = k[4];
  lens.cy = k[5];
}

LensModel readModel(const Values& values) {
  const std::string fisheye = values.find({"fisheye_model"});
  if (!fisheye.empty() && values.number(fisheye) != 0) return LensModel::kEquidistant;
  const std::string key = values.find({"distortion_model"});
  if (key.empty()) return LensModel::kRadTan;
  const std::string& name = values.at(key).word;
  if (name == "plumb_bob" || name == "rational_polynomial") return LensModel::kRadTan;
  if (name == "equidistant" || name == "fisheye") return LensModel::kEquidistant;
  if (name == "none" || name.empty()) return LensModel::kPinhole;
  throw values.error(
      key,
      fmt::format("'{}'; expected plumb_bob, rational_polynomial, equidistant or none",
                  quotable(name)));
}

Calibration calibrationOf(const Values& values) {
  const std::string matrix = values.find(kMatrixKeys);
  if (matrix.empty()) throw values.error("", "no camera_matrix");
  Calibration calibration;
  Lens& lens = calibration.lens;
  readMatrixSize(values, lens);
  readMatrix(values, matrix, lens);
  lens.model = readModel(values);
  const std::string key = values.find(kDistortionKeys);
  const std::vector<double> coefficients =
      key.empty() ? std::vector<double>() : values.at(key).numbers;
  const auto complain = [&](const std::string& what) { return values.error(key, what); };
  setCoefficients(coefficients, lens, complain);
  const bool distorted = std::any_of(coefficients.begin(),
                                     coefficients.end(),
                                     [](double coefficient) { return coefficient != 0; });
  if (lens.model == LensModel::kRadTan && !distorted) lens.model = LensModel::kPinhole;
  if (lens.model == LensModel::kPinhole) calibration.rectification.mode = RectificationMode::kNone;
  const std::string readout = values.find(kReadoutKeys);
  if (!readout.empty() && !setReadout(values.at(readout).word, lens)) {
    throw values.error(readout, fmt::format("{} are expected", kReadoutForm));
  }
  checkLens(lens, [&](const std::string& what) { return values.error(matrix, what); });
  return calibration;
}

/// A list of numbers, or the list under `data` of a matrix.
Value valueOf(const std::filesystem::path& file, const std::string& key, const YAML::Node& node) {
  Value value;
  value.line = node.Mark().line + 1;
  const YAML::Node list = node.IsMap() ? node["data"] : node;
  const auto add = [&](const YAML::Node& item) {
    double number = 0;
    if (!item.IsScalar() || !parseNumber(item.Scalar(), number)) {
      throw lineError(file, value.line, fmt::format("{}: finite numbers are expected", key));
    }
    value.numbers.push_back(number);
  };
  if (list && list.IsSequence() && list.size() <= kMaxNumbers) {
    for (const YAML::Node& item : list) add(item);
  } else if (node.IsScalar()) {
    double number = 0;
    if (parseNumber(node.Scalar(), number)) value.numbers.push_back(number);
    value.word = node.Scalar();
  }
  return value;
}

bool isKnown(const std::string& key) {
  for (const Keys* keys :
       {&kMatrixKeys, &kDistortionKeys, &kWidthKeys, &kHeightKeys, &kModelKeys, &kReadoutKeys}) {
    if (std::find(keys->begin(), keys->end(), key) != keys->end()) return true;
  }
  return false;
}

/// A word or numbers that stand in an element of cv::FileStorage; those of a matrix under `data`.
Value valueOf(const std::filesystem::path& file, const tinyxml2::XMLElement& element) {
  const tinyxml2::XMLElement* data = element.FirstChildElement("data");
  const char* text = (data != nullptr ? data : &element)->GetText();
  Value value;
  value.line = element.GetLineNum();
  if (text != nullptr) value.word = trimmed(text);
  for (const std::string& word : splitWords(text == nullptr ? "" : text)) {
    double number = 0;
    if (parseNumber(word, number) && value.numbers.size() < kMaxNumbers) {
      value.numbers.push_back(number);
    } else if (data != nullptr) {
      throw lineError(
          file,
          value.line,
          fmt::format("{}: at most {} finite numbers are expected", element.Name(), kMaxNumbers));
    }
  }
  return value;
}

}  // namespace

bool hasCameraMatrix(const YAML::Node& root) {
  return std::any_of(
      kMatrixKeys.begin(), kMatrixKeys.end(), [&](const char* key) { return bool(root[key]); });
}

Calibration readMatrixYaml(const std::filesystem::path& file, const YAML::Node& root) {
  Values values(file);
  for (const auto& entry : root) {
    if (!entry.first.IsScalar() || !isKnown(entry.first.Scalar())) continue;
    values.add(entry.first.Scalar(), valueOf(file, entry.first.Scalar(), entry.second));
  }
  return calibrationOf(values);
}

Calibration readMatrixXml(const std::filesystem::path& file, const std::string& text) {
  tinyxml2::XMLDocument document;
  if (document.Parse(text.data(), text.size()) != tinyxml2::XML_SUCCESS) {
    throw lineError(file, document.ErrorLineNum(), "no XML");
  }
  const tinyxml2::XMLElement* root = document.FirstChildElement("opencv_storage");
  if (root == nullptr) throw lineError(file, 0, "an XML file of OpenCV is expected");
  Values values(file);
  for (auto* element = root->FirstChildElement(); element != nullptr;
       element = element->NextSiblingElement()) {
    if (isKnown(element->Name())) values.add(element->Name(), valueOf(file, *element));
  }
  return calibrationOf(values);
}

}  // namespace dsorb
