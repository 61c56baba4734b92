// SPDX-License-Identifier: BSD-3-Clause
#include "io/input/image_masks.h"

#include "dsorb/error.h"

#include "io/input/image_decoder.h"

#include <fmt/format.h>

namespace dsorb {

namespace fs = std::filesystem;

ImageMasks::ImageMasks(const std::string& given, const fs::path& found, int width, int height)
    : folder_(found), width_(width), height_(height) {
  if (given.empty()) return;
  if (!fs::exists(given)) throw IoError(fmt::format("{}: no such mask or folder of masks", given));
  if (fs::is_directory(given)) {
    folder_ = given;
  } else {
    common_ = read(given);
  }
}

cv::Mat ImageMasks::of(const std::string& image) const {
  if (folder_.empty()) return {};
  const fs::path name = fs::path(image).filename();
  const fs::path png = fs::path(name).replace_extension(".png");
  for (const fs::path& candidate : {name, png, fs::path(name.string() + ".png")}) {
    if (fs::is_regular_file(folder_ / candidate)) return read(folder_ / candidate);
  }
  throw IoError(fmt::format("{}: no mask for {}; expected one for each image, here {} or {}",
                            folder_.string(),
                            image,
                            name.string(),
                            png.string()));
}

cv::Mat ImageMasks::read(const fs::path& file) const {
  cv::Mat mask = decodeGrey(readFile(file), file.string());
  if (mask.depth() != CV_8U)
    throw IoError(fmt::format("{}: a mask of 8 bits is expected", file.string()));
  if (mask.cols == width_ && mask.rows == height_) return mask;
  throw IoError(fmt::format("{}: {}x{} px; expected the size of the images, {}x{}",
                            file.string(),
                            mask.cols,
                            mask.rows,
                            width_,
                            height_));
}

}  // namespace dsorb
