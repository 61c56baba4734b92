// SPDX-License-Identifier: BSD-3-Clause
#include "two_view/model_selection.h"

#include "base/angles.h"
#include "base/median.h"
#include "features/ransac.h"
#include "two_view/essential_motion.h"

#include <Eigen/SVD>
#include <opencv2/calib3d.hpp>

#include <algorithm>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <utility>

namespace dsorb {
namespace {

constexpr int kHomographyRounds = 200;  // enough for .45 inliers; fewer are no plane
constexpr double kBehind = 1e12;        // [px^2]; a match that the model puts behind the camera

struct ModelSize {
  double dimension;  // of the manifold a match lies on
  double parameters;
};

ModelSize sizeOf(DisplacementModel model) {
  switch (model) {
    case DisplacementModel::kRotation:
      return {2, 3};
    case DisplacementModel::kHomography:
      return {2, 8};
    case DisplacementModel::kEssential:
      return {3, 5};
  }
  return {0, 0};
}

constexpr int kRounds = 10;        // the angle then changes by less than a hundredth of a pixel
constexpr double kMinChord = 0.1;  // [px]; smaller residuals are noise of the tracks
constexpr double kBehindResidual =
    1e6;  // [px]; a bearing that the rotation turns behind the camera

Eigen::Quaterniond alignBearings(const std::vector<Eigen::Vector3d>& from,
                                 const std::vector<Eigen::Vector3d>& to,
                                 const std::vector<double>& weights) {
  Eigen::Matrix3d sum = Eigen::Matrix3d::Zero();
  for (std::size_t i = 0; i < from.size(); ++i) {
    sum += weights[i] * to[i] * from[i].transpose();
  }
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(sum, Eigen::ComputeFullU | Eigen::ComputeFullV);
  const Eigen::Matrix3d& U = svd.matrixU();
  const Eigen::Matrix3d& V = svd.matrixV();
  const double handedness = (U * V.transpose()).determinant() < 0 ? -1.0 : 1.0;
  const Eigen::Matrix3d R = U * Eigen::Vector3d(1, 1, handedness).asDiagonal() * V.transpose();
  return Eigen::Quaterniond(R).normalized();
}

}  // namespace

const char* name(DisplacementModel model) {
  switch (model) {
    case DisplacementModel::kRotation:
      return "rotation";
    case DisplacementModel::kHomography:
      return "homography";
    case DisplacementModel::kEssential:
      return "essential";
  }
  return "unknown";
}

std::vector<double> homographySampsonErrors(const Eigen::Matrix3d& H_cur_ref,
                                            const Matches& matches) {
  std::vector<double> errors(matches.size(), kBehind);
  for (std::size_t i = 0; i < matches.size(); ++i) {
    const Eigen::Vector3d moved = H_cur_ref * matches.reference[i].homogeneous();
    if (!(moved.z() * H_cur_ref(2, 2) > 0)) continue;
    const Eigen::Vector2d predicted = moved.hnormalized();
    Eigen::Matrix2d J;  // of the predicted position by the reference's
    J.row(0) =
        (H_cur_ref.block<1, 2>(0, 0) - predicted.x() * H_cur_ref.block<1, 2>(2, 0)) / moved.z();
    J.row(1) =
        (H_cur_ref.block<1, 2>(1, 0) - predicted.y() * H_cur_ref.block<1, 2>(2, 0)) / moved.z();
    const Eigen::Vector2d error = matches.target[i] - predicted;
    const Eigen::Matrix2d covariance = J * J.transpose() + Eigen::Matrix2d::Identity();
    errors[i] = error.dot(covariance.inverse() * error);
  }
  return errors;
}

std::vector<double> rotationSampsonErrors(const Eigen::Quaterniond& R_cur_ref,
                                          const Matches& matches,
                                          const PinholeCamera& camera) {
  const Eigen::Matrix3d K = camera.matrix();
  return homographySampsonErrors(K * R_cur_ref.toRotationMatrix() * K.inverse(), matches);
}

double gric(DisplacementModel model, const std::vector<double>& squared_errors, double sigma) {
  constexpr double kCoordinates = 4;  // of a match
  const ModelSize size = sizeOf(model);
  const auto n = static_cast<double>(squared_errors.size());
  const double limit = 2 * (kCoordinates - size.dimension);
  double sum =
      std::log(kCoordinates) * size.dimension * n + std::log(kCoordinates * n) * size.parameters;
  for (const double squared : squared_errors) sum += std::min(squared / (sigma * sigma), limit);
  return sum;
}

std::optional<Eigen::Matrix3d> estimateHomography(const Matches& matches, std::uint64_t seed) {
  constexpr std::size_t kEnough = 8;
  if (matches.size() < kEnough) return std::nullopt;
  const cv::Mat H = cv::findHomography(toCv(matches.reference),
                                       toCv(matches.target),
                                       cv::noArray(),
                                       ransacParameters(kRansacThreshold, kHomographyRounds, seed));
  if (H.rows != 3 || H.cols != 3) return std::nullopt;
  return toEigen(H);
}

RotationFit fitRotation(const Matches& matches, const PinholeCamera& camera) {
  assert(matches.size() > 0);
  const std::size_t n = matches.size();
  std::vector<Eigen::Vector3d> from(n);
  std::vector<Eigen::Vector3d> to(n);
  for (std::size_t i = 0; i < n; ++i) {
    from[i] = camera.unproject(matches.reference[i]).normalized();
    to[i] = camera.unproject(matches.target[i]).normalized();
  }
  const double min_chord = kMinChord / camera.fx;
  std::vector<double> weights(n, 1.0);
  RotationFit fit;
  for (int round = 0; round < kRounds; ++round) {
    fit.R_cur_ref = alignBearings(from, to, weights);
    for (std::size_t i = 0; i < n; ++i) {
      weights[i] = 1.0 / std::max((fit.R_cur_ref * from[i] - to[i]).norm(), min_chord);
    }
  }
  std::vector<double> residuals(n);
  for (std::size_t i = 0; i < n; ++i) {
    const Eigen::Vector3d turned = fit.R_cur_ref * from[i];
    residuals[i] =
        turned.z() > 0 ? (camera.project(turned) - matches.target[i]).norm() : kBehindResidual;
  }
  fit.median_residual = medianOf(std::move(residuals));
  return fit;
}

double rotationResidualDeg(const Matches& matches, const PinholeCamera& camera) {
  return std::atan(fitRotation(matches, camera).median_residual / camera.fx) * kDegPerRad;
}

}  // namespace dsorb
