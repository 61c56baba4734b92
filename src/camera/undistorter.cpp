// SPDX-License-Identifier: BSD-3-Clause
#include "camera/undistorter.h"

#include "base/angles.h"
#include "camera/image_size.h"
#include "camera/lens_models.h"

#include <Eigen/LU>
#include <Eigen/SVD>

#include <algorithm>
#include <cmath>
#include <cstdio>
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

constexpr int kCheckedPixels = 33;        // a side of the image
constexpr double kMaxFisheyeAngle = 2.5;  // [rad] off the axis: the widest lenses see 280 degrees
constexpr double kMaxMagnification = 5;   // by the distortion; real lenses stay below 2
constexpr double kMaxWrongShare = 0.5;    // of the image
constexpr double kRayStep = 1e-6;
constexpr double kReprojectionTolerance = 0.5;  // [px]
constexpr double kMaxOffCentre = 0.25;          // of the principal point, of the image's size
constexpr double kMinViewDegrees = 3;
constexpr double kMaxStretch = 1.5;    // of one direction in the image beside the other
constexpr double kMinUsedShare = 0.5;  // of the image, by a crop
constexpr double kMinKeptFocal = 0.5;  // of the focal length at the centre of the lens

std::string number(double value) {
  char text[32];
  std::snprintf(text, sizeof(text), "%.4g", value);
  return text;
}

/// Change of the distorted ray with the ray.
Eigen::Matrix2d distortionSlope(const Lens& lens, const Eigen::Vector2d& ray) {
  const Eigen::Vector2d pixel = projectThroughLens(lens, ray);
  Eigen::Matrix2d J_ray;
  for (int axis = 0; axis < 2; ++axis) {
    const Eigen::Vector2d moved = ray + kRayStep * Eigen::Vector2d::Unit(axis);
    J_ray.col(axis) = (projectThroughLens(lens, moved) - pixel) / kRayStep;
  }
  J_ray.row(0) /= lens.fx;
  J_ray.row(1) /= lens.fy;
  return J_ray;
}

/// Largest distance of a column or row from the principal point [focal lengths on the axis].
double extent(const Lens& lens) {
  const Eigen::Matrix2d slope = distortionSlope(lens, {0, 0});
  const double fx = lens.fx * slope(0, 0);
  const double fy = lens.fy * slope(1, 1);
  return std::max({lens.cx / fx,
                   (lens.width - 1 - lens.cx) / fx,
                   lens.cy / fy,
                   (lens.height - 1 - lens.cy) / fy});
}

/// Whether the model is one of lenses that see half of all directions or more.
bool isWide(LensModel model) {
  return model == LensModel::kEquidistant || model == LensModel::kDoubleSphere ||
         model == LensModel::kExtendedUnified || model == LensModel::kUnified;
}

/// Share of the pixels, sampled over the image, for which a predicate of (pixel, ray) holds.
template <typename Predicate>
double shareOfPixels(const Lens& lens, double max_radius, const Predicate& holds) {
  int count = 0;
  for (int i = 0; i < kCheckedPixels * kCheckedPixels; ++i) {
    const int column = i % kCheckedPixels;
    const int row = i / kCheckedPixels;
    const Eigen::Vector2d pixel((lens.width - 1.0) * column / (kCheckedPixels - 1),
                                (lens.height - 1.0) * row / (kCheckedPixels - 1));
    if (holds(pixel, rayOfPixel(lens, pixel, max_radius))) ++count;
  }
  return static_cast<double>(count) / (kCheckedPixels * kCheckedPixels);
}

/// Rays beyond what is ever rectified are neither right nor wrong.
bool isWrong(const Lens& lens,
             bool folds,
             const Eigen::Vector2d& pixel,
             const Eigen::Vector2d& ray) {
  if (!ray.allFinite()) return true;
  const double miss = (projectThroughLens(lens, ray) - pixel).norm();
  if (!(miss < kReprojectionTolerance)) return folds || ray.cwiseAbs().maxCoeff() < kMaxRay;
  const Eigen::Matrix2d slope = distortionSlope(lens, ray);
  if (!slope.allFinite() || slope.determinant() <= 0) return true;
  return slope.jacobiSvd().singularValues()[0] > kMaxMagnification;
}

void doubtPrincipalPoint(const Lens& lens, std::vector<std::string>& doubts) {
  const double off = std::max(std::abs(lens.cx / (lens.width - 1) - 0.5),
                              std::abs(lens.cy / (lens.height - 1) - 0.5));
  if (off <= kMaxOffCentre) return;
  doubts.push_back("the principal point " + number(lens.cx) + " " + number(lens.cy) +
                   " is far from the middle of the image of " + std::to_string(lens.width) + "x" +
                   std::to_string(lens.height) + " px");
}

void doubtCrop(const Lens& lens, const PinholeCamera& camera, std::vector<std::string>& doubts) {
  const double x_min = -camera.cx / camera.fx;
  const double x_max = (camera.width - 1 - camera.cx) / camera.fx;
  const double y_min = -camera.cy / camera.fy;
  const double y_max = (camera.height - 1 - camera.cy) / camera.fy;
  const double used =
      shareOfPixels(lens, monotoneRadius(lens), [&](const Eigen::Vector2d&, const auto& ray) {
        return ray.x() >= x_min && ray.x() <= x_max && ray.y() >= y_min && ray.y() <= y_max;
      });
  const std::string remedy = "; an output camera on the third line of camera.txt may keep more";
  if (used < kMinUsedShare) {
    doubts.push_back("the crop uses " + number(std::round(100 * used)) + " % of the image" +
                     remedy);
  }
  const double kept = camera.fx / (camera.width - 1) /
                      (lens.fx * distortionSlope(lens, {0, 0})(0, 0) / (lens.width - 1));
  if (kept < kMinKeptFocal) {
    doubts.push_back("the crop sees " +
                     number(std::round(kDegPerRad * (std::atan(x_max) - std::atan(x_min)))) +
                     " degrees at " + number(std::round(100 * kept)) +
                     " % of the lens' resolution at its centre" + remedy);
  }
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

void refuseImpossibleLens(const Lens& lens) {
  const double widest = extent(lens);
  const double limit = isWide(lens.model) ? kMaxFisheyeAngle : kMaxRay;
  if (widest > limit) {
    throw std::invalid_argument(
        "focal lengths " + number(lens.fx) + " " + number(lens.fy) + " for images of " +
        std::to_string(lens.width) + "x" + std::to_string(lens.height) +
        " px: the border would lie " + number(widest) +
        " focal lengths off the axis; no lens of this model sees more than " + number(limit));
  }
  const double max_radius = monotoneRadius(lens);
  const bool folds = max_radius < std::hypot(kMaxRay, kMaxRay);
  const double wrong = shareOfPixels(lens, max_radius, [&](const auto& pixel, const auto& ray) {
    return isWrong(lens, folds, pixel, ray);
  });
  if (wrong > kMaxWrongShare) {
    throw std::invalid_argument("the distortion folds back or magnifies more than " +
                                number(kMaxMagnification) + " times in " +
                                number(std::round(100 * wrong)) + " % of the image");
  }
}

std::vector<std::string> doubtsAbout(const Lens& lens,
                                     RectificationMode mode,
                                     const PinholeCamera& camera) {
  std::vector<std::string> doubts;
  doubtPrincipalPoint(lens, doubts);
  const double view =
      std::atan((camera.width - 1 - camera.cx) / camera.fx) + std::atan(camera.cx / camera.fx);
  if (view * kDegPerRad < kMinViewDegrees) {
    doubts.push_back("the camera sees " + number(view * kDegPerRad) + " degrees only");
  }
  const double stretch = camera.fy / camera.fx / (lens.fy / lens.fx);
  if (std::max(stretch, 1 / stretch) > kMaxStretch) {
    doubts.push_back("the output size stretches images: focal lengths " + number(camera.fx) + " " +
                     number(camera.fy) + " instead of " + number(lens.fx) + " " + number(lens.fy));
  }
  if (mode == RectificationMode::kCrop) doubtCrop(lens, camera, doubts);
  return doubts;
}

}  // namespace dsorb
