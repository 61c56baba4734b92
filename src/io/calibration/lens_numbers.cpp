// SPDX-License-Identifier: BSD-3-Clause
#include "io/calibration/lens_numbers.h"

#include "dsorb/io/calibration_reader.h"

#include "camera/lens_models.h"
#include "io/text_file.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>
#include <utility>

namespace dsorb {

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

void setParameters(std::string_view names,
                   const std::vector<double>& values,
                   Lens& lens,
                   const Complain& complain) {
  const std::vector<std::string> list = splitWords(names);
  if (values.size() > list.size()) {
    throw complain(fmt::format("{} numbers; expected {}", values.size(), names));
  }
  for (std::size_t i = 0; i < values.size(); ++i) setParameter(list[i], values[i], lens, complain);
}

void simplify(Calibration& calibration) {
  Lens& lens = calibration.lens;
  const auto& k = lens.coefficients;
  if (lens.model == LensModel::kRational && k[5] == 0 && k[6] == 0 && k[7] == 0) {
    lens.model = LensModel::kRadTan;
  }
  if (isDistorted(lens)) return;
  lens.model = LensModel::kPinhole;
  calibration.rectification.mode = RectificationMode::kNone;
}

void readReadoutKey(const io::KeyedValues& values, Lens& lens) {
  if (!values.has(kReadoutKey)) return;
  if (setReadout(values.text(kReadoutKey, kReadoutForm), lens)) return;
  throw values.error(kReadoutKey, fmt::format("{} are expected", kReadoutForm));
}

namespace {

/// Checks the numbers of lenses that project by a sphere or an ellipsoid.
void checkSphere(const Lens& lens, const Complain& complain) {
  const auto [a, b] = std::pair(lens.coefficients[0], lens.coefficients[1]);
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

}  // namespace

void checkLens(const Lens& lens, const Complain& complain) {
  if (!(lens.fx > 0 && lens.fy > 0)) {
    throw complain(fmt::format("focal lengths {} {}; expected positive numbers", lens.fx, lens.fy));
  }
  if (lens.model == LensModel::kFov &&
      !(lens.coefficients[0] >= 0 && lens.coefficients[0] < M_PI)) {
    throw complain(fmt::format("omega {}; expected 0 <= omega < pi", lens.coefficients[0]));
  }
  checkSphere(lens, complain);
  if (lens.width == 0) return;
  if (lens.cx >= 0 && lens.cy >= 0 && lens.cx < lens.width && lens.cy < lens.height) return;
  throw complain(fmt::format("principal point {} {}; expected inside the image of {}x{} px",
                             lens.cx,
                             lens.cy,
                             lens.width,
                             lens.height));
}

}  // namespace dsorb
