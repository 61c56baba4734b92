// SPDX-License-Identifier: BSD-3-Clause
#include "io/calibration/calibration_forms.h"
#include "io/calibration/camera_choice.h"
#include "io/calibration/lens_numbers.h"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <string>
#include <vector>

namespace dsorb {
namespace {

using io::KeyedValues;

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
      key, {3 * columns}, fmt::format("the {} of a 3x{} matrix", 3 * columns, columns));
  const auto at = [&](std::size_t row, std::size_t column) { return m[row * columns + column]; };
  if (at(0, 1) != 0 || at(1, 0) != 0 || at(2, 0) != 0 || at(2, 1) != 0 || at(2, 2) != 1) {
    throw values.error(key, "expected fx 0 cx, 0 fy cy, 0 0 1 in the first three columns");
  }
  lens.fx = at(0, 0);
  lens.fy = at(1, 1);
  lens.cx = at(0, 2);
  lens.cy = at(1, 2);
}

void readSize(const KeyedValues& values, const std::string& key, Lens& lens) {
  const auto size = values.numbers(key, {2}, "width, height");
  setSize(size[0], size[1], lens, [&](const std::string& what) { return values.error(key, what); });
}

Calibration finished(const KeyedValues& values, const std::string& key, Calibration calibration) {
  checkLens(calibration.lens, [&](const std::string& what) { return values.error(key, what); });
  simplify(calibration);
  return calibration;
}

Calibration readOdometry(const KeyedValues& values, const std::string& key) {
  Calibration calibration;
  readProjection(values, key, calibration.lens);
  return finished(values, key, calibration);
}

/// Both kinds of images have the calibration of their size; most recordings are rectified.
Calibration readRaw(const KeyedValues& values, const std::string& number, const CameraChoice& c) {
  Calibration raw;
  Calibration rectified;
  const std::string raw_size = "S_" + number, rectified_size = "S_rect_" + number;
  if (values.has(raw_size)) readSize(values, raw_size, raw.lens);
  if (values.has(rectified_size)) readSize(values, rectified_size, rectified.lens);
  const auto fits = [&](const Lens& l) { return l.width == c.width && l.height == c.height; };
  if (values.has("P_rect_" + number) && (fits(rectified.lens) || !fits(raw.lens))) {
    readProjection(values, "P_rect_" + number, rectified.lens);
    return finished(values, "P_rect_" + number, rectified);
  }
  const std::string distortion = "D_" + number;
  readProjection(values, "K_" + number, raw.lens);
  raw.lens.model = LensModel::kRadTan;
  setParameters("k1 k2 p1 p2 k3",
                values.numbers(distortion, {5}, "k1 k2 p1 p2 k3"),
                raw.lens,
                [&](const std::string& what) { return values.error(distortion, what); });
  return finished(values, "K_" + number, raw);
}

}  // namespace

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
                         [&values, projection] { return readOdometry(values, projection); }});
    } else if (values.has("P_rect_" + two) || values.has("K_" + two)) {
      cameras.push_back({{"image_" + two, two, "P_rect_" + two, "K_" + two},
                         [&values, two, choice] { return readRaw(values, two, choice); }});
    }
  }
  return readChosen(file, cameras, choice);
}

}  // namespace dsorb
