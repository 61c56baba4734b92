// SPDX-License-Identifier: BSD-3-Clause
#include "io/input/depth_images.h"

#include "dsorb/error.h"

#include "io/input/image_decoder.h"

#include <fmt/format.h>
#include <opencv2/core.hpp>

#include <cstdint>
#include <utility>
#include <vector>

namespace dsorb {

namespace fs = std::filesystem;

namespace {

constexpr float kMetres = 1e-3F;  // of a value

}  // namespace

DepthImages::DepthImages(fs::path folder, double relative_sigma, int width, int height)
    : folder_(std::move(folder)), relative_sigma_(relative_sigma), width_(width), height_(height) {
  if (fs::is_directory(folder_)) return;
  throw IoError(fmt::format("{}: no such folder of depth images", folder_.string()));
}

std::shared_ptr<const FramePriors> DepthImages::of(const std::string& image) const {
  if (folder_.empty()) return nullptr;
  const fs::path file = folder_ / fs::path(image).filename().replace_extension(".png");
  if (!fs::is_regular_file(file)) {
    throw IoError(fmt::format("{}: no depth image for {}", file.string(), image));
  }
  const cv::Mat depth = decodeGrey(readFile(file), file.string());
  if (depth.depth() != CV_16U) {
    throw IoError(fmt::format("{}: a depth image of 16 bits is expected", file.string()));
  }
  if (depth.cols != width_ || depth.rows != height_) {
    throw IoError(fmt::format("{}: {}x{} px; expected the size of the rectified images, {}x{}",
                              file.string(),
                              depth.cols,
                              depth.rows,
                              width_,
                              height_));
  }
  std::vector<float> metres;
  metres.reserve(depth.total());
  for (int y = 0; y < depth.rows; ++y) {
    const auto* row = depth.ptr<std::uint16_t>(y);
    for (int x = 0; x < depth.cols; ++x) metres.push_back(kMetres * static_cast<float>(row[x]));
  }
  auto priors = std::make_shared<FramePriors>();
  priors->depth = denseDepth({metres.data(), depth.cols, depth.rows}, 0, relative_sigma_);
  return priors;
}

}  // namespace dsorb
