// SPDX-License-Identifier: BSD-3-Clause
#include "io/calibration_yaml.h"

#include "dsorb/io/calibration_reader.h"

#include "io/calibration_matrix.h"
#include "io/lens_numbers.h"
#include "io/text_file.h"
#include "io/yaml_text.h"

#include <fmt/format.h>
#include <yaml-cpp/yaml.h>

#include <algorithm>
#include <initializer_list>
#include <string>
#include <string_view>
#include <vector>

namespace dsorb {
namespace {

/// One mapping of the file; every complaint names file, line and key.
class Section {
 public:
  Section(const std::filesystem::path& file, const YAML::Node& node) : file_(file), node_(node) {}

  [[nodiscard]] IoError error(const char* key, const std::string& what) const {
    const YAML::Node node = node_[key];
    return lineError(file_, node ? node.Mark().line + 1 : 0, fmt::format("{}: {}", key, what));
  }
  [[nodiscard]] bool has(const char* key) const { return static_cast<bool>(node_[key]); }

  [[nodiscard]] std::string text(const char* key, const std::string& what) const {
    if (!has(key) || !node_[key].IsScalar()) throw error(key, fmt::format("{} is expected", what));
    return node_[key].Scalar();
  }
  [[nodiscard]] std::vector<double> numbers(const char* key,
                                            std::initializer_list<std::size_t> counts,
                                            const std::string& what) const {
    const YAML::Node list = node_[key];
    const std::size_t count = list && list.IsSequence() ? list.size() : 0;
    if (std::find(counts.begin(), counts.end(), count) == counts.end()) {
      throw error(key, fmt::format("{} numbers; expected {}", count, what));
    }
    std::vector<double> values;
    for (const YAML::Node& item : list) {
      double value = 0;
      if (!item.IsScalar() || !parseNumber(item.Scalar(), value)) {
        throw error(
            key,
            fmt::format("entry {} is not a finite number; expected {}", values.size() + 1, what));
      }
      values.push_back(value);
    }
    return values;
  }

 private:
  std::filesystem::path file_;
  YAML::Node node_;
};

void readDistortion(const Section& section, Lens& lens) {
  const std::string model = section.text("distortion_model", "radial-tangential or equidistant");
  const char* key =
      section.has("distortion_coeffs") ? "distortion_coeffs" : "distortion_coefficients";
  std::vector<double> coefficients;
  if (model == "radial-tangential" || model == "radtan" || model == "plumb_bob") {
    lens.model = LensModel::kRadTan;
    coefficients = section.numbers(key, {4, 5}, "k1, k2, p1, p2 and perhaps k3");
  } else if (model == "equidistant") {
    lens.model = LensModel::kEquidistant;
    coefficients = section.numbers(key, {4}, "k1, k2, k3, k4");
  } else if (model == "none") {
    lens.model = LensModel::kPinhole;
  } else {
    throw section.error(
        "distortion_model",
        fmt::format("'{}'; expected radial-tangential, equidistant or none", model));
  }
  std::copy(coefficients.begin(), coefficients.end(), lens.coefficients.begin());
}

void readReadoutKey(const Section& section, Lens& lens) {
  if (!section.has(kReadoutKey)) return;
  if (!setReadout(section.text(kReadoutKey, kReadoutForm), lens)) {
    throw section.error(kReadoutKey, fmt::format("{} are expected", kReadoutForm));
  }
}

/// cv::FileStorage begins a file with "%YAML:1.0", which is no YAML. Line numbers stay.
std::string withoutOpenCvHeader(std::string text) {
  constexpr std::string_view kHeader = "%YAML:";
  if (text.compare(0, kHeader.size(), kHeader) == 0) text.front() = '#';
  return text;
}

}  // namespace

Calibration readYamlCalibration(const std::filesystem::path& file) {
  const YAML::Node root =
      io::parseYaml(withoutOpenCvHeader(readText(file, kMaxYamlBytes)), file.string());
  if (!root.IsMap()) {
    throw lineError(file, 0, "a mapping with camera_model, intrinsics is expected");
  }
  if (hasCameraMatrix(root)) return readMatrixYaml(file, root);
  const YAML::Node camera = root["cam0"] ? root["cam0"] : root;
  if (!camera.IsMap()) {
    throw lineError(
        file, camera.Mark().line + 1, "cam0: a mapping with camera_model, intrinsics is expected");
  }
  const Section section(file, camera);

  const std::string camera_model = section.text("camera_model", "pinhole");
  if (camera_model != "pinhole") {
    throw section.error("camera_model", fmt::format("'{}'; expected pinhole", camera_model));
  }
  const auto intrinsics = section.numbers("intrinsics", {4}, "fx, fy, cx, cy");
  const auto resolution = section.numbers("resolution", {2}, "width, height");
  Calibration calibration;
  Lens& lens = calibration.lens;
  lens.fx = intrinsics[0];
  lens.fy = intrinsics[1];
  lens.cx = intrinsics[2];
  lens.cy = intrinsics[3];
  setSize(resolution[0], resolution[1], lens, [&](const std::string& what) {
    return section.error("resolution", what);
  });
  readDistortion(section, lens);
  checkLens(lens, [&](const std::string& what) { return section.error("intrinsics", what); });
  readReadoutKey(section, lens);
  return calibration;
}

}  // namespace dsorb
