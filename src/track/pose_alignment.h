// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/geometry/se3.h"
#include "dsorb/image/affine_brightness.h"
#include "dsorb/options/brightness.h"

#include "estimate/target_image.h"
#include "estimate/triangle_sums.h"
#include "geometry/row_motion.h"
#include "track/tracking_reference.h"

#include <Eigen/Core>

#include <cstddef>
#include <limits>
#include <optional>
#include <vector>

namespace dsorb::track {

/// What is known of the motion while the rows of a frame are read: the parabola through its pose
/// and two before it, and by how much that misses the velocity.
struct RowsOfFrame {
  double timestamp = 0;               ///< [s]
  std::vector<TimedPose> recent;      ///< T_cur_ref of frames before, the nearest first
  Vector6d sigma = Vector6d::Zero();  ///< standard deviation [unit/s; rad/s]

  [[nodiscard]] RowMotion predict(const SE3& T_cur_ref) const {
    return motionThrough({timestamp, T_cur_ref}, recent);
  }
};

/// The term of an alignment's energy that holds the velocity at what the frames before let expect,
/// to first order in the pose.
/// @source Schubert et al., Direct Sparse Odometry with Rolling Shutter, ECCV 2018: velocities are
///         unknowns with a prior; ours is the parabola
class VelocityTerm {
 public:
  /// @param variance of a point, of which its energy is the square [grey levels^2]
  VelocityTerm(const RowsOfFrame& rows, double variance);

  [[nodiscard]] double energy(const SE3& T_cur_ref, const Vector6d& velocity) const;
  /// Adds it to equations whose unknowns begin with the pose and end with the velocity.
  template <typename Matrix, typename Vector>
  void addTo(const SE3& T_cur_ref, const Vector6d& velocity, Matrix& H, Vector& b) const {
    const Vector6d gradient = information_.cwiseProduct(error(T_cur_ref, velocity));
    H.diagonal().template head<6>() += by_pose_ * by_pose_ * information_;
    H.diagonal().template tail<6>() += information_;
    H.template topRightCorner<6, 6>().diagonal() += by_pose_ * information_;
    H.template bottomLeftCorner<6, 6>().diagonal() += by_pose_ * information_;
    b.template head<6>() += by_pose_ * gradient;
    b.template tail<6>() += gradient;
  }

 private:
  [[nodiscard]] Vector6d error(const SE3& T_cur_ref, const Vector6d& velocity) const {
    return velocity - rows_.predict(T_cur_ref).velocity;
  }

  const RowsOfFrame& rows_;
  Vector6d information_;
  double by_pose_ = 0;  // derivative of the error by a left increment of the pose [1/s]
};

constexpr std::size_t kAlignmentBlock = 256;  ///< points summed in float before doubles take over
constexpr int kAlignmentParameters = 8;       ///< translation 3, rotation 3, brightness a and b
constexpr std::size_t kAlignmentSums = triangleSums(kAlignmentParameters);
constexpr int kRollingParameters = kAlignmentParameters + 6;  ///< and the velocity of the rows
constexpr std::size_t kRollingSums = triangleSums(kRollingParameters);

/// Constants of one evaluation, the same for all points.
struct AlignmentSetting {
  TargetImage target;        ///< level of the frame
  float affine_b_reference;  ///< [grey levels]
  /// Grey level at which the frame is clipped; infinite where it is not.
  float ceiling = std::numeric_limits<float>::infinity();
};

/// What an evaluation leaves for the normal equations, one value per point.
struct AlignmentSamples {
  std::vector<float> u, v;      ///< normalised image coordinates in the frame
  std::vector<float> rho;       ///< inverse depth in the frame [1/unit]
  std::vector<float> dx, dy;    ///< image gradient [grey levels / px]
  std::vector<float> residual;  ///< [grey levels]; 0 where the point is not used
  std::vector<float> weight;    ///< Huber weight; 0 where the point is not used or saturated
  std::vector<float> time;      ///< of the row that sees it, from the middle row; rolling shutter
                                ///< only [s]
};

/// Some points, at most kAlignmentBlock.
struct AlignmentBlock {
  std::size_t first, count;
};

/// Weighted sums of products of Jacobians and residuals of a block.
/// Jacobian of r by a left increment [translation; rotation] of the pose, then by a and b of the
/// frame: with (g_x, g_y) = (fx dI/dx, fy dI/dy), each product of these with the derivative of (u,
/// v).
void accumulateBlock(const AlignmentSetting& setting,
                     const ReferencePoints& points,
                     const AlignmentSamples& samples,
                     const AlignmentBlock& block,
                     float* sums);
/// The same for a rolling shutter. Then come derivatives by the velocity of the rows: those by the
/// pose times the time of the row.
void accumulateRollingBlock(const AlignmentSetting& setting,
                            const ReferencePoints& points,
                            const AlignmentSamples& samples,
                            const AlignmentBlock& block,
                            float* sums);

using Vector8d = Eigen::Matrix<double, 8, 1>;
using Matrix8d = Eigen::Matrix<double, 8, 8>;
using Vector14d = Eigen::Matrix<double, kRollingParameters, 1>;

/// State that alignment estimates. Increments are [translation; rotation] from the left, then a, b,
/// then the velocity.
struct AlignmentState {
  SE3 T_cur_ref;
  AffineBrightness affine;  ///< of the frame
  RowMotion motion{};       ///< while the rows of a rolling shutter are read

  [[nodiscard]] AlignmentState plus(const Vector14d& increment) const {
    return {SE3::exp(increment.head<6>()) * T_cur_ref,
            {affine.a + increment[6], affine.b + increment[7]},
            {motion.velocity + increment.tail<6>(), motion.acceleration}};
  }
};

/// One pyramid level of a frame and of the reference it is aligned to.
struct AlignmentLevel {
  const TrackingReference& reference;
  const Frame& frame;
  int level = 0;
  /// Grey level at which the frame is clipped; infinite where it is not.
  float ceiling = std::numeric_limits<float>::infinity();
  const RowsOfFrame* rows = nullptr;  ///< of a rolling shutter
};

/// Energy of one state.
struct Evaluation {
  double energy = 0;  ///< sum of Huber energies [grey levels^2]
  int used = 0;       ///< points inside the frame, saturated ones included

  /// @param prior energy beside that of the points
  [[nodiscard]] double meanEnergy(double prior = 0) const {
    return used > 0 ? (energy + prior) / used : std::numeric_limits<double>::quiet_NaN();
  }
};

/// Gauss-Newton system of one state: H = sum w J J^T, b = sum w J r.
template <int kParameters>
struct AlignmentEquations {
  using Matrix = Eigen::Matrix<double, kParameters, kParameters>;
  using Vector = Eigen::Matrix<double, kParameters, 1>;

  Matrix H = Matrix::Zero();
  Vector b = Vector::Zero();
};
using PoseEquations = AlignmentEquations<kAlignmentParameters>;
using RollingEquations = AlignmentEquations<kRollingParameters>;

struct LevelResult {
  double rmse = 0;             ///< sqrt(E / n) [grey levels]; NaN when no point is inside the frame
  double noise = 0;            ///< the same as the median tells it: without the errors of the map
  double inside_fraction = 0;  ///< points inside the frame, of all points of the level
  int iterations = 0;
  PoseEquations equations;  ///< of the state found
};

/// Direct alignment of one pyramid level: residuals r = I_frame(p') - min(gain I_reference +
/// offset, ceiling), p' the projection of the point, normal equations and the damped iteration.
/// Owns buffers that are used again from call to call. The bits of the result do not depend on the
/// number of threads.
class PoseAlignment {
 public:
  explicit PoseAlignment(BrightnessModel brightness = {}) : brightness_(brightness) {}

  Evaluation evaluate(const AlignmentLevel& level, const AlignmentState& state);

  /// Normal equations of the last state evaluated.
  [[nodiscard]] PoseEquations normalEquations();

  /// Levenberg-Marquardt from `state`, which is left at the lowest energy found.
  LevelResult align(const AlignmentLevel& level, int max_iterations, AlignmentState& state);

  /// Equations of the last state evaluated, which was that of a rolling shutter; without the prior.
  [[nodiscard]] RollingEquations rollingEquations();

  /// Standard deviation of the residuals inside the frame, from their median; of the last state
  /// evaluated [grey levels].
  [[nodiscard]] double noise();

 private:
  class Problem;

  /// Sums of one block.
  struct BlockEnergy {
    float energy;  ///< Huber energy, saturated points at their bound
    int used;      ///< points inside the frame, saturated ones included
  };

  template <int kParameters>
  [[nodiscard]] AlignmentEquations<kParameters> sumBlocks();
  /// Calls function(number, block) for all blocks of the points.
  template <typename Function>
  void forEachBlock(const Function& function);

  BrightnessModel brightness_;
  AlignmentSetting setting_{};
  const ReferencePoints* points_ = nullptr;  // of the last evaluation
  AlignmentSamples samples_;
  std::vector<BlockEnergy> block_energies_;
  std::vector<float> block_sums_;  // kAlignmentSums or kRollingSums a block
  std::vector<float> deviations_;  // of residuals [grey levels]
};

/// Residuals are not independent. Each point of the map stands on up to five pixels of level 0 and
/// brings the error of its inverse depth to all of them, and points near each other share errors of
/// the keyframes they were found with: what residuals have beyond the noise of the images counts as
/// if every eighth of them told of it. Noise counts as every third: it has made the map, too.
/// Chosen on 22 scenes, where the squared error over variance is .42 in the geometric mean.
constexpr double kResidualsPerMapError = 8;
constexpr double kResidualsPerNoise = 3;

/// Residuals that tell as much as an independent one where noise and errors of the map are not told
/// apart.
constexpr double kResidualsPerMeasurement = 7;

/// Variance to multiply the inverse of the Gauss-Newton matrix with [grey levels^2]:
///   k_n n^2 + k_m (s^2 - n^2).
/// @param rmse  s: of all residuals [grey levels]
/// @param noise n: of the images, LevelResult::noise [grey levels]
[[nodiscard]] double varianceOfResiduals(double rmse, double noise);

/// Covariance of an aligned pose, of a left increment [translation; rotation]:
///   C = v (H^-1)_pose + m^2 [t; 0] [t; 0]^T,
/// H the Gauss-Newton matrix over pose and brightness, v the variance of its residuals, t the
/// translation. m is in the source, with its reason.
/// @param equations of the finest level at `T_cur_ref`
/// @param variance  of residuals [grey levels^2]
/// @return nullopt where the points do not determine pose and brightness
[[nodiscard]] std::optional<Matrix6d> trackingCovariance(const PoseEquations& equations,
                                                         double variance,
                                                         const SE3& T_cur_ref,
                                                         BrightnessModel brightness);

}  // namespace dsorb::track
