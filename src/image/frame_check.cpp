// SPDX-License-Identifier: BSD-3-Clause
#include "image/frame_check.h"

#include "dsorb/image/pyramid.h"

#include "camera/image_size.h"
#include "image/frame_priors.h"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>
#include <string>

namespace dsorb {
namespace {

void requireOfCamera(bool holds, const char* name, double value, const char* expected) {
  if (holds) return;
  std::ostringstream message;
  message << "camera: " << name << " = " << value << "; expected " << expected;
  throw std::invalid_argument(message.str());
}

/// An odd side ends the pyramid early: too few levels for large motions.
void requirePyramid(int width, int height) {
  const int cropped_width = roundedDown(width);
  const int cropped_height = roundedDown(height);
  const int levels = pyramidLevels(width, height);
  const int full = pyramidLevels(cropped_width, cropped_height);
  if (levels >= full) return;
  std::ostringstream message;
  message << "camera: size " << width << "x" << height << " halves to " << levels
          << " pyramid levels instead of " << full << "; crop images and camera to "
          << cropped_width << "x" << cropped_height
          << " on the right and at the bottom, as Rectifier does";
  throw std::invalid_argument(message.str());
}

}  // namespace

FrameCheck::FrameCheck(const PinholeCamera& camera) : width_(camera.width), height_(camera.height) {
  const auto is_length = [](double value) { return std::isfinite(value) && value > 0; };
  requireOfCamera(width_ >= kSizeUnit, "width", width_, "at least 16 pixels");
  requireOfCamera(height_ >= kSizeUnit, "height", height_, "at least 16 pixels");
  const auto pixels = std::int64_t{width_} * height_;
  requireOfCamera(pixels <= kMaxOutputPixels,
                  "width * height",
                  static_cast<double>(pixels),
                  "at most 64 megapixels");
  requireOfCamera(is_length(camera.fx), "fx", camera.fx, "a focal length in pixels");
  requireOfCamera(is_length(camera.fy), "fy", camera.fy, "a focal length in pixels");
  requireOfCamera(std::isfinite(camera.cx), "cx", camera.cx, "a pixel");
  requireOfCamera(std::isfinite(camera.cy), "cy", camera.cy, "a pixel");
  requirePyramid(width_, height_);
}

void FrameCheck::restart() {
  ids_.clear();
  has_rows_.reset();
  timestamp_.reset();
  is_forward_.reset();
}

void FrameCheck::accept(const FramePtr& frame) {
  if (frame == nullptr) throw std::invalid_argument("frame is null");
  const std::string who = "frame " + std::to_string(frame->id().value) + ": ";
  if (frame->width() != width_ || frame->height() != height_) {
    throw std::invalid_argument(who + "size " + std::to_string(frame->width()) + "x" +
                                std::to_string(frame->height()) + " differs from the camera's " +
                                std::to_string(width_) + "x" + std::to_string(height_));
  }
  const int id = frame->id().value;
  const auto place = std::lower_bound(ids_.begin(), ids_.end(), id);
  if (place != ids_.end() && *place == id) {
    throw std::invalid_argument(who + "an earlier frame has the same id");
  }
  const double exposure = frame->exposure();
  if (!std::isfinite(exposure) || exposure <= 0) {
    throw std::invalid_argument(who + "exposure " + std::to_string(exposure) +
                                " s; expected a positive time, 1 where it is unknown");
  }
  checkPriors(*frame);
  const bool has_rows = frame->rowTimes() != nullptr;
  if (has_rows_.value_or(has_rows) != has_rows) {
    throw std::invalid_argument(who + (has_rows ? "has row times; those before have none"
                                                : "has no row times; those before have them"));
  }
  const double now = frame->timestamp();
  if (!std::isfinite(now)) throw std::invalid_argument(who + "timestamp is not finite");
  if (timestamp_) {
    const std::string both =
        who + "timestamp " + std::to_string(now) + " after " + std::to_string(*timestamp_);
    if (now == *timestamp_) throw std::invalid_argument(both + ": equal");
    const bool is_forward = now > *timestamp_;
    if (is_forward_.value_or(is_forward) != is_forward) {
      throw std::invalid_argument(both + ": time has changed its direction");
    }
    is_forward_ = is_forward;
  }
  ids_.insert(place, id);
  has_rows_ = has_rows;
  timestamp_ = now;
}

}  // namespace dsorb
