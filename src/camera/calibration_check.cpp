// SPDX-License-Identifier: BSD-3-Clause
#include "camera/calibration_check.h"

#include "base/angles.h"
#include "camera/lens_models.h"

#include <Eigen/LU>
#include <Eigen/SVD>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <stdexcept>

namespace dsorb {
namespace {

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
