// SPDX-License-Identifier: BSD-3-Clause
#include "app/image_server.h"

#include "io/input/dataset.h"

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <istream>
#include <ostream>
#include <string>

namespace dsorb::app {
namespace {

/// A row as PNM wants it: red before blue, of two bytes the higher one first.
std::string rowOf(const cv::Mat& image, int row) {
  const std::size_t bytes = static_cast<std::size_t>(image.cols) * image.elemSize();
  std::string text(reinterpret_cast<const char*>(image.ptr(row)), bytes);
  if (image.channels() == 3) {
    for (std::size_t i = 0; i + 2 < bytes; i += 3) std::swap(text[i], text[i + 2]);
  }
  if (image.depth() == CV_16U) {
    for (std::size_t i = 0; i + 1 < bytes; i += 2) std::swap(text[i], text[i + 1]);
  }
  return text;
}

void write(const SourceImage& image, std::ostream& stream) {
  const cv::Mat& pixels = image.pixels;
  stream << fmt::format("P{}\n# turn {}\n{} {}\n{}\n",
                        pixels.channels() == 3 ? 6 : 5,
                        image.turn,
                        pixels.cols,
                        pixels.rows,
                        pixels.depth() == CV_16U ? 65535 : 255);
  for (int row = 0; row < pixels.rows; ++row) stream << rowOf(pixels, row);
  stream.flush();
}

}  // namespace

void serveImages(const SequenceOptions& options, std::istream& positions, std::ostream& images) {
  const Dataset dataset = openDataset(findDataset(options.path, options.format));
  const bool video = dataset.rate > 0;
  for (int position = 0; images && positions >> position;) {
    if (position < 0 || (!video && position >= dataset.images->size())) return;
    const auto image = dataset.images->image(position);
    if (!image) return;
    write(*image, images);
  }
}

}  // namespace dsorb::app
