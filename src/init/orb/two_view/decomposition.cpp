// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/two_view/decomposition.h"

#include "base/angles.h"
#include "estimate/warp.h"
#include "init/orb/two_view/ransac.h"

#include <algorithm>
#include <cstddef>
#include <functional>

namespace dsorb::init_orb {
namespace {

constexpr int kParallaxRank = 51;         // of the point whose parallax counts
constexpr double kGoodSquaredError = 4;   // [sigma^2], ORB-SLAM's limit of the reprojection error
constexpr double kMinTranslation = 1e-9;  // of a homography's t over the plane's distance

/// @return nullopt without translation
std::optional<SE3> unitMotion(const cv::Mat& rotation, const cv::Mat& translation) {
  const Eigen::Matrix3d R = toEigen(rotation);
  const Eigen::Vector3d direction(translation.ptr<double>());
  const double length = direction.norm();
  if (!R.allFinite() || !(length > kMinTranslation)) return std::nullopt;
  return SE3(R, direction / length);
}

/// Parallax that kParallaxRank points (or all, when fewer) reach [deg].
double rankedParallax(std::vector<double>& parallaxes) {
  if (parallaxes.empty()) return 0;
  const auto place =
      parallaxes.begin() +
      std::min<std::ptrdiff_t>(kParallaxRank, static_cast<std::ptrdiff_t>(parallaxes.size())) - 1;
  std::nth_element(parallaxes.begin(), place, parallaxes.end(), std::greater<>());
  return *place;
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

std::vector<SE3> decomposeFundamental(const Eigen::Matrix3d& F, const PinholeCamera& camera) {
  const Eigen::Matrix3d K = camera.matrix();
  return decomposeEssential(K.transpose() * F * K);
}

MotionHypothesis evaluateMotion(const SE3& T_cur_ref,
                                const Matches& matches,
                                const std::vector<char>& counted,
                                const PinholeCamera& camera) {
  const double max_squared_error = kGoodSquaredError * kCornerSigma * kCornerSigma;
  const double normalized_sigma = kCornerSigma / camera.fx;
  MotionHypothesis hypothesis;
  hypothesis.T_cur_ref = T_cur_ref;
  hypothesis.points.resize(matches.size());
  std::vector<double> parallaxes;
  for (std::size_t i = 0; i < matches.size(); ++i) {
    const Eigen::Vector3d ray = camera.unproject(matches.reference[i]);
    const Eigen::Vector3d target_ray = camera.unproject(matches.target[i]);
    const auto point =
        triangulateInverseDepth(T_cur_ref, ray, target_ray.head<2>(), normalized_sigma);
    if (!point || !(point->inverse_depth > 0)) continue;
    const auto projection = projectHosted(camera, T_cur_ref, ray, point->inverse_depth);
    if (!projection || (projection->pixel - matches.target[i]).squaredNorm() > max_squared_error) {
      continue;
    }
    hypothesis.points[i] = point;
    if (counted[i] == 0) continue;
    ++hypothesis.good;
    parallaxes.push_back(parallaxAngle(T_cur_ref, ray, target_ray) * kDegPerRad);
  }
  hypothesis.parallax_deg = rankedParallax(parallaxes);
  return hypothesis;
}

}  // namespace dsorb::init_orb
