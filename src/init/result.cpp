// SPDX-License-Identifier: BSD-3-Clause
#include "init/result.h"

#include "base/angles.h"
#include "geometry/symmetric_eigen.h"
#include "geometry/tangent_basis.h"
#include "image/photometric.h"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <stdexcept>

namespace dsorb {
namespace {

constexpr double kScaleTolerance = 1e-4;     // of the mean of thousands of floats near 1
constexpr double kSymmetryTolerance = 1e-9;  // relative to the largest entry

void demand(bool holds, const char* clause, double value) {
  if (holds) return;
  std::ostringstream message;
  message << "initialization result: " << clause << " (found " << value << ")";
  throw std::logic_error(message.str());
}

double meanInverseDepth(const InitializationResult& result) {
  double sum = 0;
  int count = 0;
  for (const InitPoint& point : result.points) {
    if (point.host != 0) continue;
    sum += point.inverse_depth;
    ++count;
  }
  return count > 0 ? sum / count : 0;
}

void checkCovariance(const Matrix6d& covariance, double frame) {
  demand(covariance.allFinite(), "covariance is finite in frame", frame);
  const double largest = covariance.cwiseAbs().maxCoeff();
  demand(
      (covariance - covariance.transpose()).cwiseAbs().maxCoeff() <= kSymmetryTolerance * largest,
      "covariance is symmetric in frame",
      frame);
  const double smallest = symmetricEigen(covariance).values[0];
  demand(smallest >= -kSymmetryTolerance * largest,
         "covariance is positive semi-definite, smallest eigenvalue",
         smallest);
}

void checkFrames(const InitializationResult& result) {
  demand(
      result.frames.size() >= 2, "at least two frames", static_cast<double>(result.frames.size()));
  const PosedFrame& front = result.frames.front();
  demand(front.T_cam_ref && front.T_cam_ref->matrix() == Eigen::Matrix4d::Identity(),
         "the front frame has identity pose",
         front.T_cam_ref ? front.T_cam_ref->log().norm() : NAN);
  demand(front.affine.a == 0 && front.affine.b == 0,
         "the front frame has a = b = 0",
         std::abs(front.affine.a) + std::abs(front.affine.b));
  demand(result.frames.back().T_cam_ref.has_value(), "the back frame is posed", 0);
  for (std::size_t i = 0; i < result.frames.size(); ++i) {
    const PosedFrame& frame = result.frames[i];
    const auto index = static_cast<double>(i);
    demand(frame.frame != nullptr, "every frame has its image; one without", index);
    demand(std::isfinite(frame.affine.a) && std::isfinite(frame.affine.b),
           "affine brightness is finite in frame",
           index);
    if (frame.T_cam_ref) {
      demand(frame.T_cam_ref->matrix().allFinite(), "the pose is finite in frame", index);
    }
    if (frame.covariance) checkCovariance(*frame.covariance, index);
  }
}

void checkPoints(const InitializationResult& result) {
  for (const InitPoint& point : result.points) {
    demand(point.host >= 0 && point.host < static_cast<int>(result.frames.size()),
           "a point's host is one of the frames",
           point.host);
    const PosedFrame& host = result.frames[static_cast<std::size_t>(point.host)];
    demand(host.T_cam_ref.has_value(), "a point's host is posed", point.host);
    demand(std::isfinite(point.inverse_depth) && point.inverse_depth > 0,
           "inverse depth is finite and positive",
           point.inverse_depth);
    demand(std::isfinite(point.variance) && point.variance > 0,
           "variance is finite and positive",
           point.variance);
    const auto right = static_cast<float>(host.frame->width() - 1 - kPatternRadius);
    const auto bottom = static_cast<float>(host.frame->height() - 1 - kPatternRadius);
    demand(point.pixel.x() >= kPatternRadius && point.pixel.x() <= right,
           "a pixel keeps the pattern's border, x",
           point.pixel.x());
    demand(point.pixel.y() >= kPatternRadius && point.pixel.y() <= bottom,
           "a pixel keeps the pattern's border, y",
           point.pixel.y());
  }
}

/// Degrees of freedom of the t-distribution of a direction's errors, whose tails are those of
/// starts on real sequences.
constexpr double kFreedom = 4;

}  // namespace

const char* name(InitReason reason) {
  switch (reason) {
    case InitReason::kFirstFrame:
      return "first_frame";
    case InitReason::kTooFewPoints:
      return "too_few_points";
    case InitReason::kTooLittleParallax:
      return "too_little_parallax";
    case InitReason::kSettling:
      return "settling";
    case InitReason::kTrackingLost:
      return "tracking_lost";
    case InitReason::kDegenerateMotion:
      return "degenerate_motion";
    case InitReason::kPoorQuality:
      return "poor_quality";
    case InitReason::kTimeout:
      return "timeout";
    case InitReason::kDone:
      return "done";
    case InitReason::kHurried:
      return "hurried";
  }
  return "unknown";
}

std::optional<double> InitReport::detail(const std::string& name) const {
  const auto found = std::find_if(
      details.rbegin(), details.rend(), [&](const Detail& detail) { return detail.name == name; });
  return found == details.rend() ? std::nullopt : std::optional(found->value);
}

void changeUnit(double mean, std::vector<PosedFrame>& frames) {
  for (PosedFrame& frame : frames) {
    if (frame.T_cam_ref) frame.T_cam_ref->setTranslation(frame.T_cam_ref->translation() * mean);
    if (!frame.covariance) continue;
    frame.covariance->topRows<3>() *= mean;
    frame.covariance->leftCols<3>() *= mean;
  }
}

void normalizeScale(InitializationResult& result) {
  const double mean = meanInverseDepth(result);
  demand(mean > 0 && std::isfinite(mean), "mean inverse depth of the reference", mean);
  for (InitPoint& point : result.points) changeUnit(mean, point.inverse_depth, point.variance);
  changeUnit(mean, result.frames);
}

void checkInvariants(const InitializationResult& result) {
  checkFrames(result);
  checkPoints(result);
  const double mean = meanInverseDepth(result);
  demand(std::abs(mean - 1) < kScaleTolerance, "mean inverse depth of the reference is 1", mean);
}

Eigen::Vector2d directionSigmasDeg(const PosedFrame& frame) {
  const Eigen::Vector3d& t = frame.T_cam_ref->translation();
  const Eigen::Matrix<double, 3, 2> basis = tangentBasis(t.normalized());
  const Eigen::Matrix2d covariance =
      basis.transpose() * frame.covariance->topLeftCorner<3, 3>() * basis / t.squaredNorm();
  const Eigen::VectorXd variances = symmetricEigen(covariance).values.cwiseMax(0);
  return kDegPerRad * variances.cwiseSqrt();
}

double tailProbability(const Eigen::Vector2d& sigmas_deg, double angle_deg) {
  // In polar coordinates of the whitened plane the radius has a closed tail, (1 + r^2 / f)^(-f/2).
  constexpr int kAngles = 16;  // of a quarter: the others are alike
  double sum = 0;
  for (int i = 0; i < kAngles; ++i) {
    const double angle = (i + 0.5) * M_PI / 2 / kAngles;
    const double length =
        std::hypot(std::cos(angle) * sigmas_deg[0], std::sin(angle) * sigmas_deg[1]);
    const double radius = angle_deg / length;
    sum += std::pow(1 + radius * radius / kFreedom, -kFreedom / 2);
  }
  return sum / kAngles;
}

double rivalProbability(double cost_ratio, double samples) {
  return 1 / (1 + std::pow(cost_ratio, samples));
}

}  // namespace dsorb
