// SPDX-License-Identifier: BSD-3-Clause
#include "two_view/model_selection.h"

#include "features/ransac.h"

#include <opencv2/calib3d.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>

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

std::optional<Eigen::Matrix3d> estimateHomography(const Matches& matches,
                                                  double threshold,
                                                  std::uint64_t seed) {
  constexpr std::size_t kEnough = 8;
  if (matches.size() < kEnough) return std::nullopt;
  const cv::Mat H = cv::findHomography(toCv(matches.reference),
                                       toCv(matches.target),
                                       cv::noArray(),
                                       ransacParameters(threshold, kHomographyRounds, seed));
  if (H.rows != 3 || H.cols != 3) return std::nullopt;
  return toEigen(H);
}

}  // namespace dsorb
