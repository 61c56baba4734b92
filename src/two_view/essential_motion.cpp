// SPDX-License-Identifier: BSD-3-Clause
#include "two_view/essential_motion.h"

#include "base/median.h"
#include "estimate/robust_loss.h"
#include "features/ransac.h"
#include "geometry/tangent_basis.h"
#include "geometry/triangulate.h"

#include <Eigen/Cholesky>
#include <opencv2/calib3d.hpp>

#include <algorithm>
#include <cmath>
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

using Matrix5d = Eigen::Matrix<double, 5, 5>;
using Vector5d = Eigen::Matrix<double, 5, 1>;

constexpr int kMaxIterations = 15;
constexpr double kMinStep = 1e-7;  // [rad]; far below a hundredth of a pixel
constexpr double kMaxStep = 0.2;   // [rad]; a longer Gauss-Newton step leaves its linear range
constexpr double kDamping = 1e-9;  // of the diagonal, against the singular case of no parallax

struct Rays {
  std::vector<Eigen::Vector3d> reference;
  std::vector<Eigen::Vector3d> target;
};

Rays countedRays(const Matches& matches,
                 const std::vector<char>& counted,
                 const PinholeCamera& camera) {
  Rays rays;
  for (std::size_t i = 0; i < matches.size(); ++i) {
    if (counted[i] == 0) continue;
    rays.reference.push_back(camera.unproject(matches.reference[i]));
    rays.target.push_back(camera.unproject(matches.target[i]));
  }
  return rays;
}

/// @param inverse_sigma of the residual, in normalised units
Vector5d gaussNewtonStep(const SE3& T_cur_ref, const Rays& rays, double inverse_sigma) {
  const Eigen::Matrix<double, 3, 2> basis = tangentBasis(T_cur_ref.translation());
  Matrix5d H = Matrix5d::Zero();
  Vector5d b = Vector5d::Zero();
  for (std::size_t i = 0; i < rays.reference.size(); ++i) {
    const EpipolarResidual residual =
        epipolarResidual(T_cur_ref, rays.reference[i], rays.target[i], basis);
    const double whitened = residual.value * inverse_sigma;
    const double weight = 1 / cauchyRatio(whitened * whitened, 1);
    H += weight * residual.J.transpose() * residual.J;
    b -= weight * residual.J.transpose() * residual.value;
  }
  H.diagonal() += kDamping * H.diagonal();
  return H.ldlt().solve(b);
}

constexpr int kMaxRounds = 1000;  // of RANSAC; it stops when it is sure
constexpr int kMinMatches = 8;    // of OpenCV's local optimisation
constexpr int kRefits = 2;        // of motion and inliers; the inliers then stay the same

/// The one of an essential matrix' four motions with most inliers in front of both cameras.
SE3 mostInFront(const std::vector<SE3>& motions,
                const Matches& matches,
                const std::vector<char>& inlier,
                const PinholeCamera& camera) {
  SE3 best;
  int most = -1;
  for (const SE3& motion : motions) {
    int in_front = 0;
    for (std::size_t i = 0; i < matches.size(); ++i) {
      if (inlier[i] == 0) continue;
      const Eigen::Vector3d ray = camera.unproject(matches.reference[i]);
      const Eigen::Vector2d target = camera.unproject(matches.target[i]).head<2>();
      const auto point = triangulateInverseDepth(motion, ray, target, 1);
      if (!point || !(point->inverse_depth > 0)) continue;
      const double z =
          (motion.unitQuaternion() * ray).z() + point->inverse_depth * motion.translation().z();
      if (z > 0) ++in_front;
    }
    if (in_front > most) {
      most = in_front;
      best = motion;
    }
  }
  return best;
}

/// The motion moved to the minimum over its inliers, and its inliers counted anew.
EssentialMotion refineOnInliers(const SE3& T_cur_ref,
                                const Matches& matches,
                                const PinholeCamera& camera,
                                double threshold) {
  EssentialMotion motion{T_cur_ref, {}};
  for (int refit = 0; refit <= kRefits; ++refit) {
    std::vector<double> distances = countInliers(matches, camera, threshold, motion);
    const auto middle = distances.begin() + motion.inliers / 2;
    std::nth_element(distances.begin(), middle, distances.end());
    motion.noise = kMadToSigma * *middle;
    if (refit == kRefits || motion.inliers < kMinMatches) break;
    motion.T_cur_ref =
        refineMotion(motion.T_cur_ref, matches, motion.inlier, camera, threshold / 2);
  }
  return motion;
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

EpipolarResidual epipolarResidual(const SE3& T_cur_ref,
                                  const Eigen::Vector3d& reference,
                                  const Eigen::Vector3d& target,
                                  const Eigen::Matrix<double, 3, 2>& basis) {
  const Eigen::Vector3d& t = T_cur_ref.translation();
  const Eigen::Vector3d turned = T_cur_ref.unitQuaternion() * reference;
  const Eigen::Vector3d line_target = t.cross(turned);
  // E^T x_t = R^T (x_t x t), the line in the reference
  const Eigen::Vector3d line_reference = T_cur_ref.unitQuaternion().conjugate() * target.cross(t);
  const double gradient =
      std::sqrt(line_target.head<2>().squaredNorm() + line_reference.head<2>().squaredNorm());
  EpipolarResidual residual;
  residual.J.setZero();
  if (!(gradient > 0)) return residual;
  residual.value = target.dot(line_target) / gradient;
  // x_t . (t x (w x y)) = w . (y x (x_t x t)) and x_t . (d x y) = d . (y x x_t)
  residual.J.head<3>() = turned.cross(target.cross(t)).transpose() / gradient;
  residual.J.tail<2>() = turned.cross(target).transpose() * basis / gradient;
  return residual;
}

SE3 refineMotion(const SE3& T_cur_ref,
                 const Matches& matches,
                 const std::vector<char>& counted,
                 const PinholeCamera& camera,
                 double sigma) {
  const Rays rays = countedRays(matches, counted, camera);
  const double inverse_sigma = camera.fx / sigma;
  SE3 refined = T_cur_ref;
  // Bounded steps that are never refused, unlike minimize()'s: callers judge where they have led.
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    Vector5d step = gaussNewtonStep(refined, rays, inverse_sigma);
    if (!step.allFinite()) return T_cur_ref;
    if (step.norm() > kMaxStep) step *= kMaxStep / step.norm();
    const Eigen::Vector3d t =
        refined.translation() + tangentBasis(refined.translation()) * step.tail<2>();
    refined = SE3(so3Exp(step.head<3>()) * refined.unitQuaternion(), t.normalized());
    if (step.norm() < kMinStep) break;
  }
  return refined;
}

std::vector<double> epipolarDistances(const SE3& T_cur_ref,
                                      const Matches& matches,
                                      const PinholeCamera& camera) {
  const auto basis = tangentBasis(T_cur_ref.translation());
  std::vector<double> distances(matches.size());
  for (std::size_t i = 0; i < matches.size(); ++i) {
    distances[i] = camera.fx * std::abs(epipolarResidual(T_cur_ref,
                                                         camera.unproject(matches.reference[i]),
                                                         camera.unproject(matches.target[i]),
                                                         basis)
                                            .value);
  }
  return distances;
}

std::vector<double> countInliers(const Matches& matches,
                                 const PinholeCamera& camera,
                                 double threshold,
                                 EssentialMotion& motion) {
  std::vector<double> distances = epipolarDistances(motion.T_cur_ref, matches, camera);
  motion.inlier.clear();
  for (const double distance : distances) motion.inlier.push_back(distance < threshold ? 1 : 0);
  motion.inliers =
      static_cast<int>(std::count(motion.inlier.begin(), motion.inlier.end(), char{1}));
  return distances;
}

std::optional<EssentialMotion> estimateEssentialMotion(const Matches& matches,
                                                       const PinholeCamera& camera,
                                                       std::uint64_t seed) {
  if (static_cast<int>(matches.size()) < kMinCornersOfMotion) {
    return std::nullopt;
  }
  const cv::Matx33d K = toCv(camera.matrix());
  const cv::Mat no_distortion = cv::Mat::zeros(1, 4, CV_64F);
  cv::Mat mask;
  const cv::Mat E = cv::findEssentialMat(toCv(matches.reference),
                                         toCv(matches.target),
                                         K,
                                         K,
                                         no_distortion,
                                         no_distortion,
                                         mask,
                                         ransacParameters(kRansacThreshold, kMaxRounds, seed));
  if (E.rows != 3 || E.cols != 3) return std::nullopt;
  std::vector<char> inlier(matches.size(), 0);
  for (std::size_t i = 0; i < inlier.size(); ++i) {
    inlier[i] = mask.at<std::uint8_t>(static_cast<int>(i)) != 0 ? 1 : 0;
  }
  const std::vector<SE3> motions = decomposeEssential(toEigen(E));
  if (motions.empty()) return std::nullopt;
  EssentialMotion motion = refineOnInliers(
      mostInFront(motions, matches, inlier, camera), matches, camera, kRansacThreshold);
  if (motion.inliers < kMinCornersOfMotion) return std::nullopt;
  return motion;
}

}  // namespace dsorb
