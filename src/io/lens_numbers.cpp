// SPDX-License-Identifier: BSD-3-Clause
#include "io/lens_numbers.h"

#include "dsorb/io/calibration_reader.h"

#include "camera/lens_models.h"
#include "io/text_file.h"

#include <fmt/format.h>

#include <cmath>
#include <optional>

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

void setCoefficients(const std::vector<double>& coefficients,
                     Lens& lens,
                     const Complain& complain) {
  const std::size_t places = nameOf(lens.model).coefficients;
  for (std::size_t i = 0; i < coefficients.size(); ++i) {
    if (i < places) {
      lens.coefficients[i] = coefficients[i];
    } else if (coefficients[i] != 0) {
      throw complain(fmt::format(
          "distortion coefficient {} is {}: this model has {} here (of radial-tangential lenses k1 "
          "k2 p1 p2 k3; no rational model, thin prism or tilt); calibrate without the others",
          i + 1,
          coefficients[i],
          places));
    }
  }
}

void checkLens(const Lens& lens, const Complain& complain) {
  if (!(lens.fx > 0 && lens.fy > 0)) {
    throw complain(fmt::format("focal lengths {} {}; expected positive numbers", lens.fx, lens.fy));
  }
  if (lens.model == LensModel::kFov &&
      !(lens.coefficients[0] >= 0 && lens.coefficients[0] < M_PI)) {
    throw complain(fmt::format("omega {}; expected 0 <= omega < pi", lens.coefficients[0]));
  }
  if (lens.width == 0) return;
  if (lens.cx >= 0 && lens.cy >= 0 && lens.cx < lens.width && lens.cy < lens.height) return;
  throw complain(fmt::format("principal point {} {}; expected inside the image of {}x{} px",
                             lens.cx,
                             lens.cy,
                             lens.width,
                             lens.height));
}

}  // namespace dsorb
