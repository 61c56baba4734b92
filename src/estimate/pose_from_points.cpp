// SPDX-License-Identifier: BSD-3-Clause
#include "estimate/pose_from_points.h"

#include "estimate/robust_loss.h"
#include "estimate/warp.h"
#include "image/cell_grid.h"

#include <Eigen/Cholesky>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace dsorb {
namespace {

constexpr std::size_t kMinObservations = 10;  // six unknowns, two equations each, and some to spare
constexpr int kMaxIterations = 20;
constexpr double kMinStep = 1e-8;             // norm of the increment; the end of iteration
const double kHuberLimit = std::sqrt(5.991);  // [sigma]; chi-square, 2 dof, 95 %

/// Observations arranged for the kernels.
class ObservationArrays {
 public:
  explicit ObservationArrays(const std::vector<PointObservation>& observations)
      : stride_(wholeLanes(observations.size())), arrays_(kNumRows * stride_, 0.0) {
    for (std::size_t i = 0; i < observations.size(); ++i) {
      at(kRayX, i) = observations[i].host_ray.x();
      at(kRayY, i) = observations[i].host_ray.y();
      at(kInverseDepth, i) = observations[i].inverse_depth;
      at(kPixelX, i) = observations[i].pixel.x();
      at(kPixelY, i) = observations[i].pixel.y();
      at(kInformation, i) = 1;
    }
  }

  [[nodiscard]] PoseSums linearize(const PinholeCamera& camera,
                                   const SE3& T_cam_host,
                                   double limit) const {
    PoseSums sums;
    linearizeObservations(makeWarp<double>(camera, T_cam_host),
                          {row(kRayX),
                           row(kRayY),
                           row(kInverseDepth),
                           row(kPixelX),
                           row(kPixelY),
                           row(kInformation),
                           row(kZero),
                           row(kInformation),
                           stride_},
                          {RobustLoss::kHuber, limit},
                          {},
                          sums);
    return sums;
  }

 private:
  enum Row { kRayX, kRayY, kInverseDepth, kPixelX, kPixelY, kInformation, kZero, kNumRows };
  double& at(Row row, std::size_t i) { return arrays_[row * stride_ + i]; }
  [[nodiscard]] const double* row(Row row) const { return arrays_.data() + row * stride_; }

  std::size_t stride_;
  std::vector<double> arrays_;
};

/// Sum over cells of the image of g g^T, g the gradient of the cell's observations.
Matrix6d gradientSpread(const std::vector<PointObservation>& observations,
                        const PinholeCamera& camera,
                        const SE3& T_cam_host,
                        double limit) {
  std::array<Vector6d, kErrorCells> gradients;
  gradients.fill(Vector6d::Zero());
  std::array<bool, kErrorCells> used{};
  for (const PointObservation& observation : observations) {
    const auto projection =
        projectHosted(camera, T_cam_host, observation.host_ray, observation.inverse_depth);
    if (!projection) continue;
    const Eigen::Vector2d error = projection->pixel - observation.pixel;
    const std::size_t cell = imageCell(camera.project(observation.host_ray), camera);
    used[cell] = true;
    gradients[cell] += projection->J_pose.transpose() * (huberWeight(error.norm(), limit) * error);
  }
  Matrix6d spread = Matrix6d::Zero();
  int cells = 0;
  for (std::size_t cell = 0; cell < kErrorCells; ++cell) {
    if (!used[cell]) continue;
    spread += gradients[cell] * gradients[cell].transpose();
    ++cells;
  }
  return spread * (static_cast<double>(cells) / std::max(cells - 1, 1));
}

/// Robust normal equations of a pose, as the last iteration of poseFromPoints() has them.
/// @return nullopt with too few observations, or with less than half of them within the Huber limit
std::optional<PoseSums> poseEquations(const std::vector<PointObservation>& observations,
                                      const PinholeCamera& camera,
                                      const SE3& T_cam_host,
                                      double sigma) {
  if (observations.size() < kMinObservations) return std::nullopt;
  const PoseSums sums =
      ObservationArrays(observations).linearize(camera, T_cam_host, huberLimit(sigma));
  if (2 * sums.within < static_cast<double>(observations.size())) return std::nullopt;
  return sums;
}

}  // namespace

double huberLimit(double sigma) {
  return kHuberLimit * sigma;
}

std::optional<SE3> poseFromPoints(const std::vector<PointObservation>& observations,
                                  const PinholeCamera& camera,
                                  const SE3& guess,
                                  double sigma) {
  if (observations.size() < kMinObservations) return std::nullopt;
  const double limit = huberLimit(sigma);
  const ObservationArrays arrays(observations);
  SE3 T_cam_host = guess;
  // Steps are never refused, unlike minimize()'s: the observations within the limit judge the end.
  for (int iteration = 0; iteration < kMaxIterations; ++iteration) {
    const PoseSums sums = arrays.linearize(camera, T_cam_host, limit);
    const Vector6d step = -sums.hessian.ldlt().solve(sums.gradient);
    if (!step.allFinite()) return std::nullopt;
    T_cam_host = SE3::exp(step) * T_cam_host;
    if (step.norm() < kMinStep) break;
  }
  const double within = arrays.linearize(camera, T_cam_host, limit).within;
  if (2 * within < static_cast<double>(observations.size())) return std::nullopt;
  return T_cam_host;
}

std::optional<Matrix6d> poseCovariance(const std::vector<PointObservation>& observations,
                                       const PinholeCamera& camera,
                                       const SE3& T_cam_host,
                                       const ObservationNoise& noise) {
  const std::optional<PoseSums> sums = poseEquations(observations, camera, T_cam_host, noise.sigma);
  if (!sums) return std::nullopt;
  const Eigen::LDLT<Matrix6d> hessian(sums->hessian);
  if (!hessian.isPositive()) return std::nullopt;
  const Matrix6d inverse = hessian.solve(Matrix6d::Identity());
  const Vector6d step = inverse * sums->gradient;
  Matrix6d covariance = sums->weighted_square / (2 * sums->observations - kPoseSize) * inverse +
                        step * step.transpose();
  if (noise.variance_factor > 0) {
    const double limit = huberLimit(noise.sigma);
    covariance += noise.variance_factor * inverse *
                  gradientSpread(observations, camera, T_cam_host, limit) * inverse;
  }
  covariance = (0.5 * (covariance + covariance.transpose())).eval();
  return covariance.allFinite() ? std::optional(covariance) : std::nullopt;
}

}  // namespace dsorb
