// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/io/calibration_reader.h"

#include "camera/photometric_correction.h"
#include "io/input/image_decoder.h"
#include "io/text_file.h"

#include <fmt/format.h>
#include <opencv2/core.hpp>

#include <string>
#include <vector>

namespace dsorb {
namespace {

constexpr double kMaxLevel = 255;  // [grey levels]

}  // namespace

std::vector<float> readResponse(const std::filesystem::path& file) {
  const std::vector<TextLine> lines = readLines(file, kMaxCalibrationBytes);
  const std::string what = "at least 256 increasing numbers on one line";
  if (lines.empty()) throw lineError(file, 0, fmt::format("is empty; expected {}", what));
  const int line = lines.front().number;
  const auto raw = parseNumbers(file, line, splitWords(lines.front().text), what);
  if (raw.size() < kMinResponseEntries) {
    throw lineError(file, line, fmt::format("{} numbers; expected {}", raw.size(), what));
  }
  std::vector<float> response;
  response.reserve(raw.size());
  const double range = raw.back() - raw.front();
  for (std::size_t i = 0; i < raw.size(); ++i) {
    response.push_back(static_cast<float>(kMaxLevel * (raw[i] - raw.front()) / range));
    if (i > 0 && !(response[i] > response[i - 1] && raw[i] > raw[i - 1])) {
      throw lineError(
          file,
          line,
          fmt::format(
              "number {} ({}) is not above the one before; expected {}", i + 1, raw[i], what));
    }
  }
  return response;
}

void readVignette(const std::filesystem::path& file, PhotometricCalibration& calibration) {
  const cv::Mat image = decodeGrey(readFile(file), file.string());
  double maximum = 0;
  cv::minMaxLoc(image, nullptr, &maximum);
  if (maximum <= 0) throw lineError(file, 0, "the vignette is black everywhere");
  cv::Mat attenuation;
  image.convertTo(attenuation, CV_32F, 1 / maximum);
  calibration.vignette_width = image.cols;
  calibration.vignette_height = image.rows;
  calibration.vignette.assign(attenuation.begin<float>(), attenuation.end<float>());
}

}  // namespace dsorb
