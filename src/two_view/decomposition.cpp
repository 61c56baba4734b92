// SPDX-License-Identifier: BSD-3-Clause
#include "two_view/decomposition.h"

#include "features/ransac.h"

#include <cstddef>

namespace dsorb {
namespace {

constexpr double kMinTranslation = 1e-9;  // of a homography's t over the plane's distance

/// @return nullopt without translation
std::optional<SE3> unitMotion(const cv::Mat& rotation, const cv::Mat& translation) {
  const Eigen::Matrix3d R = toEigen(rotation);
  const Eigen::Vector3d direction(translation.ptr<double>());
  const double length = direction.norm();
  if (!R.allFinite() || !(length > kMinTranslation)) return std::nullopt;
  return SE3(R, direction / length);
}

}  // namespace

std::vector<SE3> decomposeHomography(const Eigen::Matrix3d& H_cur_ref,
                                     const PinholeCamera& camera) {
  std::vector<cv::Mat> rotations;
  std::vector<cv::Mat> translations;
  std::vector<cv::Mat> normals;
  cv::decomposeHomographyMat(
      toCv(H_cur_ref), toCv(camera.matrix()), rotations, translations, normals);
  std::vector<SE3> motions;
  for (std::size_t i = 0; i < rotations.size(); ++i) {
    if (const auto motion = unitMotion(rotations[i], translations[i])) motions.push_back(*motion);
  }
  return motions;
}

std::vector<SE3> decomposeEssential(const Eigen::Matrix3d& E) {
  cv::Mat first;
  cv::Mat second;
  cv::Mat translation;
  cv::decomposeEssentialMat(toCv(E), first, second, translation);
  std::vector<SE3> motions;
  for (const cv::Mat& rotation : {first, second}) {
    for (const double sign : {1.0, -1.0}) {
      if (const auto motion = unitMotion(rotation, sign * translation)) motions.push_back(*motion);
    }
  }
  return motions;
}

}  // namespace dsorb
