// SPDX-License-Identifier: BSD-3-Clause
#include "two_view/motion_refinement.h"

#include "estimate/robust_loss.h"
#include "geometry/tangent_basis.h"

#include <Eigen/Cholesky>

#include <cmath>
#include <cstddef>

namespace dsorb {
namespace {

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
    double ratio = 1;
    double weight = 1;
    cauchyWeights(whitened * whitened, 1.0, ratio, weight);
    H += weight * residual.J.transpose() * residual.J;
    b -= weight * residual.J.transpose() * residual.value;
  }
  H.diagonal() += kDamping * H.diagonal();
  return H.ldlt().solve(b);
}

}  // namespace

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

}  // namespace dsorb
