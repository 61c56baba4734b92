// SPDX-License-Identifier: BSD-3-Clause
#include "camera/lens_models.h"

#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <stdexcept>

namespace dsorb {
namespace {

constexpr double kTinyRadius = 1e-8;     // below it the distortion factor is its limit
constexpr double kRadiusStep = 1e-3;     // walk outwards from the axis
constexpr double kShrinkFactor = 0.995;  // of one edge in one round
constexpr int kMaxShrinkRounds = 500;
constexpr double kInitialMargin = 1.01;  // of the range along the axes, before shrinking
constexpr int kGrowPasses = 2;
constexpr int kBisections = 24;  // of an interval of about 2 px: 1e-7 px
constexpr int kNewtonSteps = 20;
constexpr double kDerivativeStep = 1e-6;

/// Factor from the plane z = 1 to the plane of the mirror, to which the tangential terms belong.
double mirrorFactor(const Lens& lens, double r2) {
  return lens.model == LensModel::kUnified ? 1 / (1 + lens.coefficients[0] * std::sqrt(1 + r2)) : 1;
}

/// Radius of the distorted ray over the ideal radius r, without tangential terms.
double radialFactor(const Lens& lens, double r) {
  const auto& k = lens.coefficients;
  const double r2 = r * r;
  switch (lens.model) {
    case LensModel::kPinhole:
      return 1;
    case LensModel::kRadTan:
      return 1 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]));
    case LensModel::kFov: {
      if (k[0] == 0) return 1;
      const double slope = 2 * std::tan(k[0] / 2);
      return r < kTinyRadius ? slope / k[0] : std::atan(r * slope) / (k[0] * r);
    }
    case LensModel::kEquidistant: {
      if (r < kTinyRadius) return 1;
      const double theta = std::atan(r);
      const double t2 = theta * theta;
      return theta * (1 + t2 * (k[0] + t2 * (k[1] + t2 * (k[2] + t2 * k[3])))) / r;
    }
    case LensModel::kRational:
      return (1 + r2 * (k[0] + r2 * (k[1] + r2 * k[4]))) /
             (1 + r2 * (k[5] + r2 * (k[6] + r2 * k[7])));
    case LensModel::kDoubleSphere: {
      const double z = k[0] * std::sqrt(1 + r2) + 1;  // in the second sphere
      return 1 / (k[1] * std::sqrt(r2 + z * z) + (1 - k[1]) * z);
    }
    case LensModel::kExtendedUnified:
      return 1 / (k[0] * std::sqrt(k[1] * r2 + 1) + (1 - k[0]));
    case LensModel::kUnified: {
      const double mirror = mirrorFactor(lens, r2);
      const double m2 = mirror * mirror * r2;
      return mirror * (1 + m2 * (k[1] + m2 * k[2]));
    }
  }
  throw std::invalid_argument("unknown lens model");
}

Eigen::Vector2d distort(const Lens& lens, const Eigen::Vector2d& ray) {
  Eigen::Vector2d distorted = radialFactor(lens, ray.norm()) * ray;
  if (const std::size_t place = tangentialPlace(lens.model)) {
    const Eigen::Vector2d m = mirrorFactor(lens, ray.squaredNorm()) * ray;
    const double p1 = lens.coefficients[place];
    const double p2 = lens.coefficients[place + 1];
    const double xy = m.x() * m.y();
    const double r2 = m.squaredNorm();
    distorted.x() += 2 * p1 * xy + p2 * (r2 + 2 * m.x() * m.x());
    distorted.y() += 2 * p2 * xy + p1 * (r2 + 2 * m.y() * m.y());
  }
  return distorted;
}

/// Value between `inside`, where the predicate holds, and `outside`, where it does not.
template <typename Predicate>
double bisect(double inside, double outside, const Predicate& holds) {
  for (int i = 0; i < kBisections; ++i) {
    const double middle = 0.5 * (inside + outside);
    (holds(middle) ? inside : outside) = middle;
  }
  return inside;
}

/// Which rays fall inside the input image.
class FieldOfView {
 public:
  explicit FieldOfView(const Lens& lens) : lens_(lens), max_radius_(monotoneRadius(lens)) {}

  [[nodiscard]] bool columnInside(const Eigen::Vector2d& ray) const {
    const double u = projectThroughLens(lens_, ray).x();
    return ray.norm() <= max_radius_ && u >= 0 && u <= lens_.width - 1;
  }
  [[nodiscard]] bool rowInside(const Eigen::Vector2d& ray) const {
    const double v = projectThroughLens(lens_, ray).y();
    return ray.norm() <= max_radius_ && v >= 0 && v <= lens_.height - 1;
  }
  [[nodiscard]] bool inside(const Eigen::Vector2d& ray) const {
    return columnInside(ray) && rowInside(ray);
  }
  /// Distance from the axis along a direction to the first ray outside.
  [[nodiscard]] double reach(const Eigen::Vector2d& direction) const {
    double distance = 0;
    while (distance < kMaxRay && inside((distance + kRadiusStep) * direction)) {
      distance += kRadiusStep;
    }
    return bisect(
        distance, distance + kRadiusStep, [&](double d) { return inside(d * direction); });
  }

 private:
  Lens lens_;
  double max_radius_;
};

template <typename Predicate>
bool holdsAlong(const Eigen::Vector2d& from,
                const Eigen::Vector2d& to,
                int samples,
                const Predicate& holds) {
  for (int i = 0; i < samples; ++i) {
    if (!holds(from + (to - from) * (static_cast<double>(i) / (samples - 1)))) return false;
  }
  return true;
}

bool verticalEdgeInside(const FieldOfView& view, const RayRectangle& r, double x, int samples) {
  return holdsAlong({x, r.y_min}, {x, r.y_max}, samples, [&](const Eigen::Vector2d& ray) {
    return view.columnInside(ray);
  });
}

bool horizontalEdgeInside(const FieldOfView& view, const RayRectangle& r, double y, int samples) {
  return holdsAlong({r.x_min, y}, {r.x_max, y}, samples, [&](const Eigen::Vector2d& ray) {
    return view.rowInside(ray);
  });
}

bool perimeterInside(const FieldOfView& view, const RayRectangle& r, int width, int height) {
  const auto inside = [&](const Eigen::Vector2d& ray) { return view.inside(ray); };
  return holdsAlong({r.x_min, r.y_min}, {r.x_max, r.y_min}, width, inside) &&
         holdsAlong({r.x_min, r.y_max}, {r.x_max, r.y_max}, width, inside) &&
         holdsAlong({r.x_min, r.y_min}, {r.x_min, r.y_max}, height, inside) &&
         holdsAlong({r.x_max, r.y_min}, {r.x_max, r.y_max}, height, inside);
}

/// One round: every edge with a ray outside moves inwards. Where a vertical and a horizontal one
/// would, only the one of the wider extent does. @return whether an edge moved
bool shrinkOnce(const FieldOfView& view, int width, int height, RayRectangle& r) {
  bool left = !verticalEdgeInside(view, r, r.x_min, height);
  bool right = !verticalEdgeInside(view, r, r.x_max, height);
  bool top = !horizontalEdgeInside(view, r, r.y_min, width);
  bool bottom = !horizontalEdgeInside(view, r, r.y_max, width);
  if ((left || right) && (top || bottom)) {
    const bool wide = r.x_max - r.x_min > r.y_max - r.y_min;
    if (wide) top = bottom = false;
    if (!wide) left = right = false;
  }
  if (left) r.x_min *= kShrinkFactor;
  if (right) r.x_max *= kShrinkFactor;
  if (top) r.y_min *= kShrinkFactor;
  if (bottom) r.y_max *= kShrinkFactor;
  return left || right || top || bottom;
}

/// Moves one edge outwards as far as the whole rectangle stays inside.
void growEdge(
    const FieldOfView& view, int width, int height, double RayRectangle::*edge, RayRectangle& r) {
  const auto fits = [&](double value) {
    RayRectangle trial = r;
    trial.*edge = value;
    return perimeterInside(view, trial, width, height);
  };
  double inside = r.*edge;
  if (inside == 0) return;  // the principal point lies on this edge of the image: nothing beyond
  double outside = inside / kShrinkFactor;
  while (std::abs(outside) < kMaxRay && fits(outside)) {
    inside = outside;
    outside /= kShrinkFactor;
  }
  r.*edge = bisect(inside, outside, fits);
}

}  // namespace

bool isDistorted(const Lens& lens) {
  return lens.model == LensModel::kEquidistant ||
         std::any_of(lens.coefficients.begin(), lens.coefficients.end(), [&](double coefficient) {
           return lens.model != LensModel::kPinhole && coefficient != 0;
         });
}

Eigen::Vector2d projectThroughLens(const Lens& lens, const Eigen::Vector2d& ray) {
  const Eigen::Vector2d distorted = distort(lens, ray);
  return {lens.fx * distorted.x() + lens.cx, lens.fy * distorted.y() + lens.cy};
}

double monotoneRadius(const Lens& lens) {
  const double limit = std::hypot(kMaxRay, kMaxRay);
  double radius = 0;
  double distorted = 0;
  while (radius < limit) {
    const double next = std::min(radius + kRadiusStep, limit);
    const double next_distorted = next * radialFactor(lens, next);
    if (!(next_distorted > distorted)) break;
    radius = next;
    distorted = next_distorted;
  }
  return radius;
}

Eigen::Vector2d rayOfPixel(const Lens& lens, const Eigen::Vector2d& pixel, double max_radius) {
  Eigen::Vector2d target((pixel.x() - lens.cx) / lens.fx, (pixel.y() - lens.cy) / lens.fy);
  const double distance = target.norm();
  if (distance < kTinyRadius) return target;
  if (max_radius * radialFactor(lens, max_radius) <= distance) {
    return target * (max_radius / distance);
  }
  const double radius =
      bisect(0, max_radius, [&](double r) { return r * radialFactor(lens, r) <= distance; });
  Eigen::Vector2d ray = target * (radius / distance);
  for (int i = 0; i < kNewtonSteps; ++i) {
    const Eigen::Vector2d value = distort(lens, ray);
    Eigen::Matrix2d J_ray;
    for (int axis = 0; axis < 2; ++axis) {
      const Eigen::Vector2d moved = ray + kDerivativeStep * Eigen::Vector2d::Unit(axis);
      J_ray.col(axis) = (distort(lens, moved) - value) / kDerivativeStep;
    }
    ray -= J_ray.inverse() * (value - target);
  }
  return ray;
}

PinholeCamera RayRectangle::camera(int width, int height) const {
  const double fx = (width - 1) / (x_max - x_min);
  const double fy = (height - 1) / (y_max - y_min);
  return {fx, fy, -x_min * fx, -y_min * fy, width, height};
}

RayRectangle largestInscribedRectangle(const Lens& lens, int width, int height) {
  const FieldOfView view(lens);
  if (!view.inside({0, 0})) {
    throw std::invalid_argument("the principal point lies outside the input image");
  }
  RayRectangle r;
  r.x_min = -kInitialMargin * view.reach({-1, 0});
  r.x_max = kInitialMargin * view.reach({1, 0});
  r.y_min = -kInitialMargin * view.reach({0, -1});
  r.y_max = kInitialMargin * view.reach({0, 1});
  int round = 0;
  while (round < kMaxShrinkRounds && shrinkOnce(view, width, height, r)) ++round;
  while (round < kMaxShrinkRounds && !perimeterInside(view, r, width, height)) {
    for (double* edge : {&r.x_min, &r.x_max, &r.y_min, &r.y_max}) *edge *= kShrinkFactor;
    ++round;
  }
  if (round == kMaxShrinkRounds || !(r.x_min < r.x_max) || !(r.y_min < r.y_max)) {
    throw std::invalid_argument(
        "no rectangle around the optical axis lies inside the input image; check the lens");
  }
  for (int pass = 0; pass < kGrowPasses; ++pass) {
    for (const auto edge :
         {&RayRectangle::x_min, &RayRectangle::x_max, &RayRectangle::y_min, &RayRectangle::y_max}) {
      growEdge(view, width, height, edge, r);
    }
  }
  return r;
}

RayRectangle boundingRectangle(const Lens& lens) {
  const double max_radius = monotoneRadius(lens);
  RayRectangle r;
  const auto include = [&](double u, double v) {
    const Eigen::Vector2d ray = rayOfPixel(lens, {u, v}, max_radius);
    r.x_min = std::max(std::min(r.x_min, ray.x()), -kMaxRay);
    r.x_max = std::min(std::max(r.x_max, ray.x()), kMaxRay);
    r.y_min = std::max(std::min(r.y_min, ray.y()), -kMaxRay);
    r.y_max = std::min(std::max(r.y_max, ray.y()), kMaxRay);
  };
  for (int u = 0; u < lens.width; ++u) {
    include(u, 0);
    include(u, lens.height - 1);
  }
  for (int v = 0; v < lens.height; ++v) {
    include(0, v);
    include(lens.width - 1, v);
  }
  return r;
}

}  // namespace dsorb
