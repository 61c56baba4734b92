// SPDX-License-Identifier: BSD-3-Clause
#include "window/window_step.h"

#include "dsorb/camera/calibration.h"

#include "estimate/variance_factors.h"
#include "geometry/symmetric_eigen.h"
#include "window/normal_equations.h"
#include "window/pair_geometry.h"

#include <Eigen/Cholesky>
#include <Eigen/Core>

#include <algorithm>
#include <cmath>
#include <utility>

namespace dsorb::window {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

constexpr double kSingularCutOff = 1e-5;  // relative, of gauge directions

// Variance of a pixel's residual that turns variances of priors into information [grey levels^2]:
// of the size of those after a start, 5 to 9 grey levels.
constexpr double kPriorNoise = 49;

constexpr double kPreconditionerOffset = 10;  // @source DSO as published

// Standard deviations by which phones and webcams differ, for a guessed camera.
// These are for a focal length known to kStatedFocalSigma (shareOfGuess).
constexpr double kAspectSigma = 0.003;  // relative, of the ratio of the two focal lengths
constexpr double kCenterSigma = 0.02;   // of the principal point, as a share of the width
constexpr double kRadialSigma = 0.1;    // of the radial distortion k1

/// Normal equations of the linearised energy, priors included and depths eliminated; the rows of
/// quantities that are not estimated are there, too.
struct ReducedSystem {
  MatrixXd H;
  VectorXd b;
};

/// Leaves out what is not estimated of the camera.
void holdOthers(const EstimatedCamera& camera, ReducedSystem& system) {
  for (Index i = 0; i < kCameraDim; ++i) {
    if (camera.has(i)) continue;
    system.H.row(i).setZero();
    system.H.col(i).setZero();
    system.H(i, i) = 1;
    system.b[i] = 0;
  }
}

ReducedSystem reduce(const Window& window,
                     const WindowEquations& equations,
                     const WindowOptions& options,
                     double damping,
                     WindowElimination& elimination) {
  const StatePrior prior = statePrior(window, options);
  ReducedSystem system{equations.H + window.prior.H, {}};
  MatrixXd& H = system.H;
  VectorXd& b = system.b;
  H.diagonal() += prior.information;
  H.topLeftCorner<kIntrinsicsDim, kIntrinsicsDim>() += prior.guess;
  H.diagonal() *= 1 + damping;
  b = equations.b + prior.gradient + window.prior.b + window.prior.H * window.deviation();
  elimination.damp(equations, damping);
  elimination.eliminate(equations, H, b);
  holdOthers(estimatedCamera(window, options), system);
  return system;
}

/// Dense symmetric system with diagonal preconditioning.
class PreconditionedSystem {
 public:
  explicit PreconditionedSystem(const MatrixXd& H)
      : scale_((H.diagonal().array().abs() + kPreconditionerOffset).sqrt().inverse()),
        factor_(scale_.asDiagonal() * H * scale_.asDiagonal()) {}

  template <typename Right>
  [[nodiscard]] Right solve(const Right& b) const {
    return scale_.asDiagonal() * factor_.solve(scale_.asDiagonal() * b);
  }
  /// Columns r with sum of r r^T = H^-1; nothing where H is not positive.
  [[nodiscard]] std::optional<MatrixXd> roots() const {
    if (!(factor_.vectorD().minCoeff() > 0)) return std::nullopt;
    const MatrixXd diagonal = factor_.vectorD().cwiseSqrt().cwiseInverse().asDiagonal();
    MatrixXd columns = factor_.matrixU().solve(diagonal);
    columns = factor_.transpositionsP().transpose() * columns;
    return MatrixXd(scale_.asDiagonal() * columns);
  }

 private:
  VectorXd scale_;
  Eigen::LDLT<MatrixXd> factor_;
};

double cameraScale(Index row) {
  if (row == kReadout) return kReadoutScale;
  return row == kRadial ? kRadialScale : kCameraScale;
}

/// Sigmas of the rest of a camera over those of one whose field of view is a guess: what tells the
/// focal length tells the rest as well.
/// @param options with a focal_sigma above 0
double shareOfGuess(const PriorOptions& options) {
  return std::min(1.0, options.focal_sigma / kStatedFocalSigma);
}

/// Information of a camera of which the field of view is a guess: mean focal length, ratio of the
/// two, principal point. It must count as the pixels do, whose errors are not independent.
Eigen::Matrix4d guessInformation(const PinholeCamera& camera, const PriorOptions& options) {
  const double share = shareOfGuess(options);
  const double center = share * kCenterSigma * camera.width;
  Eigen::Matrix4d whiten = Eigen::Matrix4d::Zero();
  whiten.row(0).head<2>() << 0.5 / camera.fx, 0.5 / camera.fy;
  whiten.row(0) /= options.focal_sigma;
  whiten.row(1).head<2>() << 1 / camera.fx, -1 / camera.fy;
  whiten.row(1) /= share * kAspectSigma;
  whiten(2, 2) = whiten(3, 3) = 1 / center;
  const double weight = kPriorNoise * variance_factors::kWindow * variance_factors::kWindow *
                        kCameraScale * kCameraScale;
  return weight * whiten.transpose() * whiten;
}

constexpr double kFocalSigma = 0.5;  // relative: that nearly nothing is known of it

WindowOptions withGuessedCamera(WindowOptions options) {
  options.optimizer.optimize_intrinsics = true;
  options.prior.focal_sigma = kFocalSigma;
  return options;
}

}  // namespace

Vector6d velocityInformation(const Window& window, const Keyframe& keyframe) {
  constexpr double kHeld = 1e6;  // a thousandth of the standard deviation
  const double weight = (window.velocities_held ? kHeld : 1) * kPriorNoise *
                        variance_factors::kWindow * variance_factors::kWindow;
  return weight * velocityScale().cwiseQuotient(keyframe.rows.sigma).cwiseAbs2();
}

EstimatedCamera estimatedCamera(const Window& window, const WindowOptions& options) {
  const bool intrinsics = options.optimizer.optimize_intrinsics;
  return {intrinsics,
          window.calibratedReadout().sigma > 0,
          intrinsics && options.prior.focal_sigma > 0};
}

StatePrior statePrior(const Window& window, const WindowOptions& options) {
  StatePrior prior;
  prior.information = VectorXd::Zero(window.dimension());
  VectorXd value(window.dimension());
  value.head<kCameraDim>() = window.camera_state;
  const EstimatedCamera camera = estimatedCamera(window, options);
  if (camera.radial) {
    prior.guess = guessInformation(window.first_camera, options.prior);
    const double scaled =
        variance_factors::kWindow * kRadialScale / (shareOfGuess(options.prior) * kRadialSigma);
    prior.information[kRadial] = kPriorNoise * scaled * scaled;
  } else if (camera.intrinsics) {
    prior.information.head<kIntrinsicsDim>().setConstant(options.prior.intrinsics);
  }
  if (camera.readout) {
    const double scaled = kReadoutScale / window.calibratedReadout().sigma;
    prior.information[kReadout] = kPriorNoise * scaled * scaled;
  }
  for (std::size_t k = 0; k < window.keyframes.size(); ++k) {
    const Keyframe& keyframe = window.keyframes[k];
    const Index at = window.rowOf(k);
    prior.information.segment<kFrameDim>(at) = keyframe.prior;
    value.segment<kFrameDim>(at) = keyframe.state;
    if (!window.hasVelocities()) continue;
    prior.information.segment<kVelocityDim>(at + kFrameDim) = velocityInformation(window, keyframe);
    value.segment<kVelocityDim>(at + kFrameDim) =
        keyframe.velocityFrom(keyframe.rows.mean.velocity);
  }
  prior.gradient = prior.information.cwiseProduct(value);
  if (camera.radial) {
    prior.gradient.head<kIntrinsicsDim>() += prior.guess * value.head<kIntrinsicsDim>();
  }
  prior.energy = prior.gradient.dot(value);
  return prior;
}

MatrixXd gaugeDirections(const Window& window) {
  MatrixXd directions = MatrixXd::Zero(window.dimension(), 7);
  const Eigen::Matrix<double, 6, 1> to_scaled = frameScale().head<6>().cwiseInverse();
  for (std::size_t k = 0; k < window.keyframes.size(); ++k) {
    const Keyframe& keyframe = window.keyframes[k];
    const Index at = window.rowOf(k);
    const SE3& T = keyframe.T_cam_world_first;
    directions.block<6, 6>(at, 0) = to_scaled.asDiagonal() * T.adjoint();
    directions.block<3, 1>(at, 6) = to_scaled.head<3>().cwiseProduct(T.translation());
    if (!window.hasVelocities()) continue;
    directions.block<3, 1>(at + kFrameDim, 6) =
        keyframe.first_velocity.cwiseQuotient(velocityScale()).head<3>();
  }
  for (Index i = 0; i < directions.cols(); ++i) {
    const double norm = directions.col(i).norm();
    if (norm > 0) directions.col(i) /= norm;
  }
  return directions;
}

MatrixXd withoutGauge(const MatrixXd& steps, const MatrixXd& directions) {
  const Eigen::Matrix<double, 7, 7> gram = directions.transpose() * directions;
  const SymmetricEigen eigen = symmetricEigen(gram);
  const double cut_off = kSingularCutOff * kSingularCutOff * eigen.values[6];
  MatrixXd result = steps;
  for (Index i = 0; i < 7; ++i) {
    const double eigenvalue = eigen.values[i];
    if (!(eigenvalue > cut_off)) continue;
    const VectorXd direction = directions * eigen.vectors.col(i) / std::sqrt(eigenvalue);
    for (Index k = 0; k < steps.cols(); ++k) {
      result.col(k) -= direction * direction.dot(steps.col(k));
    }
  }
  return result;
}

namespace {

/// @param noise of a pixel's residual [grey levels]
std::optional<Matrix6d> newestPoseCovariance(const Window& window,
                                             const PreconditionedSystem& system,
                                             double noise) {
  MatrixXd columns = MatrixXd::Zero(window.dimension(), 6);
  columns.middleRows<6>(window.rowOf(window.keyframes.size() - 1)).setIdentity();
  columns = withoutGauge(columns, gaugeDirections(window));
  const Matrix6d scaled = columns.transpose() * system.solve(columns);
  const Vector6d scale = variance_factors::kWindow * noise * frameScale().head<6>();
  const Matrix6d covariance =
      scale.asDiagonal() * (0.5 * (scaled + scaled.transpose())) * scale.asDiagonal();
  const bool usable = covariance.allFinite() && covariance.diagonal().minCoeff() > 0;
  return usable ? std::optional(covariance) : std::nullopt;
}

/// @param noise of a pixel's residual [grey levels]
std::vector<float> depthVariances(const Window& window,
                                  const WindowEquations& equations,
                                  const PreconditionedSystem& system,
                                  double noise) {
  std::vector<float> variances(equations.points(), 0.0F);
  const auto roots = system.roots();
  if (!roots) return variances;
  const Eigen::MatrixXf of_frames =
      (variance_factors::kWindow * noise * withoutGauge(*roots, gaugeDirections(window)))
          .cast<float>();
  const Eigen::VectorXf shared = (equations.couplings() * of_frames).rowwise().squaredNorm();
  const auto own = static_cast<float>(noise * noise);
  for (std::size_t i = 0; i < variances.size(); ++i) {
    if (!equations.known(i)) continue;
    const float h = equations.depth_hessian[i];
    variances[i] = own / h + shared[static_cast<Index>(i)] / (h * h);
  }
  return variances;
}

}  // namespace

StateStep solveStep(const Window& window,
                    const WindowEquations& equations,
                    const WindowOptions& options,
                    double damping,
                    WindowElimination& elimination) {
  const ReducedSystem system = reduce(window, equations, options, damping, elimination);
  return {-PreconditionedSystem(system.H).solve(system.b), system.b};
}

WindowUncertainty uncertaintyOf(const Window& window,
                                const WindowEquations& equations,
                                const WindowOptions& options,
                                double noise,
                                WindowElimination& elimination) {
  ReducedSystem reduced = reduce(window, equations, options, 0, elimination);
  const PreconditionedSystem system(reduced.H);
  const EstimatedCamera camera = estimatedCamera(window, options);
  WindowUncertainty uncertainty;
  for (Index i = 0; i < kCameraDim; ++i) {
    if (!camera.has(i)) continue;
    const VectorXd unit = VectorXd::Unit(reduced.b.size(), i);
    uncertainty.camera_sigmas[i] =
        variance_factors::kWindow * cameraScale(i) * noise * std::sqrt(system.solve(unit)[i]);
  }
  uncertainty.newest_pose = newestPoseCovariance(window, system, noise);
  uncertainty.depth_variances = depthVariances(window, equations, system, noise);
  uncertainty.newest_pose_camera_held = uncertainty.newest_pose;
  if (!camera.intrinsics) return uncertainty;
  uncertainty.newest_pose_camera_held.reset();
  if (window.keyframes.front().id.value <= window.forgotten) return uncertainty;
  holdOthers({false, camera.readout, false}, reduced);
  const PreconditionedSystem held(reduced.H);
  uncertainty.newest_pose_camera_held = newestPoseCovariance(window, held, noise);
  return uncertainty;
}

CameraScore scoreCamera(Window& window, const WindowOptions& options, double noise) {
  const WindowOptions guessed = withGuessedCamera(options);
  LinearizeOptions linearize;
  linearize.camera = estimatedCamera(window, guessed);
  linearize.depth_prior_factor = 0;
  NormalEquationsBuilder builder;
  WindowEquations equations;
  WindowElimination elimination;
  builder.build(window, PairTable(window), allPoints(window), linearize, equations);

  const Eigen::Index size = window.dimension();
  const MarginalPrior kept =
      std::exchange(window.prior, {Eigen::MatrixXd::Zero(size, size), Eigen::VectorXd::Zero(size)});
  const Eigen::VectorXd step = solveStep(window, equations, guessed, 0, elimination).change;
  const CameraVector sigmas =
      uncertaintyOf(window, equations, guessed, noise, elimination).camera_sigmas;
  window.prior = kept;

  const PinholeCamera& camera = window.first_camera;
  return {0.5 * kCameraScale * (step[0] / camera.fx + step[1] / camera.fy),
          0.5 * (sigmas[0] / camera.fx + sigmas[1] / camera.fy),
          {kRadialScale * step[kRadial], sigmas[kRadial]}};
}

}  // namespace dsorb::window
