// SPDX-License-Identifier: BSD-3-Clause
#include "camera/undistorter.h"

#include "camera/image_size.h"
#include "camera/lens_models.h"

#include <algorithm>
#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

namespace dsorb {
namespace {

constexpr double kBorderTolerance = 1e-3;  // [px] rounding of rays on the border
constexpr int kMaxSamplesPerSide = 8;

constexpr std::int64_t kMaxInputPixels = std::int64_t{1} << 28;

void checkPixels(const char* what, int width, int height, std::int64_t most) {
  if (std::int64_t{width} * height <= most) return;
  throw std::invalid_argument(what + (" size " + sizeText(width, height)) + ": at most " +
                              std::to_string(most >> 20) + " megapixels are expected");
}

void checkFocal(double fx, double fy, double cx, double cy) {
  if (!(std::isfinite(fx) && std::isfinite(fy) && fx > 0 && fy > 0)) {
    throw std::invalid_argument("focal lengths " + std::to_string(fx) + " " + std::to_string(fy) +
                                ": positive numbers are expected");
  }
  if (!std::isfinite(cx) || !std::isfinite(cy)) {
    throw std::invalid_argument("the principal point is not finite");
  }
}

PinholeCamera targetCamera(const Lens& lens, const Rectification& wanted) {
  const int width = wanted.width > 0 ? wanted.width : lens.width;
  const int height = wanted.height > 0 ? wanted.height : lens.height;
  const int cropped_width = roundedDown(width);
  const int cropped_height = roundedDown(height);
  if (cropped_width <= 0 || cropped_height <= 0) {
    throw std::invalid_argument("output size " + sizeText(width, height) + ": at least " +
                                sizeText(kSizeUnit, kSizeUnit) + " is expected");
  }
  checkPixels("output", width, height, kMaxOutputPixels);
  switch (wanted.mode) {
    case RectificationMode::kCrop:
      return largestInscribedRectangle(lens, cropped_width, cropped_height)
          .camera(cropped_width, cropped_height);
    case RectificationMode::kFull:
      return boundingRectangle(lens).camera(cropped_width, cropped_height);
    case RectificationMode::kNone:
      if (isDistorted(lens)) {
        throw std::invalid_argument(
            std::string("rectification 'none' would leave the distortion of this ") +
            nameOf(lens.model).name + " lens in the images; expected crop, full or, of images " +
            "that are undistorted already, a pinhole");
      }
      if (width != lens.width || height != lens.height) {
        throw std::invalid_argument("rectification 'none' cannot turn " +
                                    sizeText(lens.width, lens.height) + " into " +
                                    sizeText(width, height));
      }
      return {lens.fx, lens.fy, lens.cx, lens.cy, cropped_width, cropped_height};
    case RectificationMode::kExplicit: {
      const PinholeCamera& camera = wanted.camera;
      checkFocal(camera.fx, camera.fy, camera.cx, camera.cy);
      return {camera.fx, camera.fy, camera.cx, camera.cy, cropped_width, cropped_height};
    }
  }
  throw std::invalid_argument("unknown rectification mode");
}

}  // namespace

Undistorter::Undistorter(const Lens& lens, const Rectification& rectification)
    : input_width_(lens.width), input_height_(lens.height) {
  checkFocal(lens.fx, lens.fy, lens.cx, lens.cy);
  if (lens.width < kSizeUnit || lens.height < kSizeUnit) {
    throw std::invalid_argument("input size " + sizeText(lens.width, lens.height) + ": at least " +
                                sizeText(kSizeUnit, kSizeUnit) + " is expected");
  }
  checkPixels("input", lens.width, lens.height, kMaxInputPixels);
  if (!std::all_of(lens.coefficients.begin(), lens.coefficients.end(), [](double coefficient) {
        return std::isfinite(coefficient);
      })) {
    throw std::invalid_argument("a lens coefficient is not finite");
  }
  camera_ = targetCamera(lens, rectification);
  camera_.focal_sigma = lens.focal_sigma;
  if (rectification.mode != RectificationMode::kNone) {
    chooseSamples(lens);
    buildMap(lens);
  }
}

/// Takes as many samples per output pixel as it covers input pixels around the optical axis.
void Undistorter::chooseSamples(const Lens& lens) {
  const Eigen::Vector2d axis = projectThroughLens(lens, {0, 0});
  const Eigen::Vector2d right = projectThroughLens(lens, {1 / camera_.fx, 0});
  const Eigen::Vector2d below = projectThroughLens(lens, {0, 1 / camera_.fy});
  const auto samples = [](double reduction) {
    return std::clamp(static_cast<int>(std::lround(reduction)), 1, kMaxSamplesPerSide);
  };
  samples_x_ = samples((right - axis).norm());
  samples_y_ = samples((below - axis).norm());
}

void Undistorter::buildMap(const Lens& lens) {
  const double max_radius = monotoneRadius(lens);
  const double last_u = lens.width - 1;
  const double last_v = lens.height - 1;
  const auto see = [&](double x, double y, const Eigen::Vector2d& otherwise) -> Eigen::Vector2d {
    const Eigen::Vector2d ray((x - camera_.cx) / camera_.fx, (y - camera_.cy) / camera_.fy);
    const bool invertible = ray.norm() <= max_radius + kBorderTolerance / camera_.fx;
    return invertible ? projectThroughLens(lens, ray) : otherwise;
  };
  const auto sample_at = [&](const Eigen::Vector2d& position) -> Sample {
    const double u = std::clamp(position.x(), 0.0, last_u);
    const double v = std::clamp(position.y(), 0.0, last_v);
    const int column = std::min(static_cast<int>(u), lens.width - 2);
    const int row = std::min(static_cast<int>(v), lens.height - 2);
    return {row * lens.width + column, static_cast<float>(u - column), static_cast<float>(v - row)};
  };
  const float nan = std::numeric_limits<float>::quiet_NaN();
  const int samples = samples_x_ * samples_y_;
  map_.reserve(static_cast<std::size_t>(camera_.width) * static_cast<std::size_t>(camera_.height) *
               static_cast<std::size_t>(samples));
  for (int y = 0; y < camera_.height; ++y) {
    for (int x = 0; x < camera_.width; ++x) {
      const Eigen::Vector2d centre = see(x, y, {-1, -1});
      const bool valid = centre.x() >= -kBorderTolerance && centre.y() >= -kBorderTolerance &&
                         centre.x() <= last_u + kBorderTolerance &&
                         centre.y() <= last_v + kBorderTolerance;
      for (int i = 0; i < samples; ++i) {
        if (!valid) {
          map_.push_back({0, nan, nan});
          continue;
        }
        const double dx = (i % samples_x_ + 0.5) / samples_x_ - 0.5;
        const int row = i / samples_x_;
        const double dy = (row + 0.5) / samples_y_ - 0.5;
        map_.push_back(sample_at(see(x + dx, y + dy, centre)));
      }
    }
  }
}

void Undistorter::apply(const float* input, float* output) const {
  const std::ptrdiff_t stride = input_width_;
  if (map_.empty()) {
    for (int y = 0; y < camera_.height; ++y) {
      std::copy_n(input + y * stride, camera_.width, output);
      output += camera_.width;
    }
    return;
  }
  // Offsets are made once. The samplers of src/estimate take positions, and lie above this.
  const auto interpolate = [input, stride](const Sample& s) {
    const float* top = input + s.offset;
    const float* bottom = top + stride;
    const float above = top[0] + s.fx * (top[1] - top[0]);
    const float below = bottom[0] + s.fx * (bottom[1] - bottom[0]);
    return above + s.fy * (below - above);
  };
  const std::ptrdiff_t pixels = static_cast<std::ptrdiff_t>(camera_.width) * camera_.height;
  const Sample* sample = map_.data();
  const int count = samples_x_ * samples_y_;
  if (count == 1) {
    for (std::ptrdiff_t i = 0; i < pixels; ++i) output[i] = interpolate(sample[i]);
    return;
  }
  const float weight = 1.0F / static_cast<float>(count);
  for (std::ptrdiff_t i = 0; i < pixels; ++i) {
    float sum = 0;
    for (int k = 0; k < count; ++k) sum += interpolate(*sample++);
    output[i] = weight * sum;
  }
}

}  // namespace dsorb
