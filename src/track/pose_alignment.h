// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"
#include "dsorb/image/affine_brightness.h"
#include "dsorb/options/brightness.h"

#include "estimate/target_image.h"
#include "estimate/triangle_sums.h"
#include "track/tracking_reference.h"

#include <Eigen/Core>

#include <array>
#include <cstddef>
#include <limits>
#include <optional>
#include <vector>

namespace dsorb::track {

constexpr std::size_t kAlignmentBlock = 256;  ///< points summed in float before doubles take over
constexpr int kAlignmentParameters = 8;       ///< translation 3, rotation 3, brightness a and b
constexpr std::size_t kAlignmentSums = triangleSums(kAlignmentParameters);

/// Constants of one evaluation, the same for all points.
struct AlignmentSetting {
  TargetImage target;        ///< level of the frame
  float affine_b_reference;  ///< [grey levels]
  float cutoff;              ///< [grey levels]
  /// At which the frame is clipped [grey levels]; infinite where it is not.
  float ceiling = std::numeric_limits<float>::infinity();
};

/// Reference points; arrays of the same length.
struct PointArrays {
  const float* ray_x;
  const float* ray_y;
  const float* inverse_depth;
  const float* intensity;
};

/// What an evaluation leaves for the normal equations, one value per point.
struct SampleArrays {
  float* u;         ///< normalised image coordinate in the frame
  float* v;         ///<
  float* rho;       ///< inverse depth in the frame [1/unit]
  float* dx;        ///< image gradient [grey levels / px]
  float* dy;        ///<
  float* residual;  ///< [grey levels]; 0 where the point is not used
  float* weight;    ///< Huber weight; 0 where the point is not used or saturated
};

struct BlockEnergy {
  float energy;   ///< Huber energy, saturated points at their bound
  int used;       ///< points inside the frame, saturated ones included
  int saturated;  ///< points with a residual above the cut-off
};

/// Weighted sums of products of Jacobians and residuals of `count` <= kAlignmentBlock points.
/// Jacobian of r by a left increment [translation; rotation] of the pose, then by a and b of the
/// frame: with (g_x, g_y) = (fx dI/dx, fy dI/dy), each product of these with the derivative of (u,
/// v).
void accumulateBlock(const AlignmentSetting& setting,
                     const PointArrays& points,
                     const SampleArrays& samples,
                     std::size_t count,
                     std::array<float, kAlignmentSums>& sums);

using Vector8d = Eigen::Matrix<double, 8, 1>;
using Matrix8d = Eigen::Matrix<double, 8, 8>;

/// State that alignment estimates. Increments are [translation; rotation] from the left, then a, b.
struct AlignmentState {
  SE3 T_frame_reference;
  AffineBrightness affine;  ///< of the frame

  [[nodiscard]] AlignmentState plus(const Vector8d& increment) const {
    return {SE3::exp(increment.head<6>()) * T_frame_reference,
            {affine.a + increment[6], affine.b + increment[7]}};
  }
};

/// One pyramid level of a frame and of the reference it is aligned to.
struct AlignmentLevel {
  const TrackingReference& reference;
  const Frame& frame;
  int level = 0;
  /// At which the frame is clipped [grey levels].
  float ceiling = std::numeric_limits<float>::infinity();
  std::optional<RollingShutter> shutter{};  ///< of the level of the frame
};

/// Energy of one state.
struct Evaluation {
  double energy = 0;  ///< sum of Huber energies [grey levels^2]
  int used = 0;       ///< points inside the frame, saturated ones included
  int saturated = 0;

  [[nodiscard]] double meanEnergy() const {
    return used > 0 ? energy / used : std::numeric_limits<double>::quiet_NaN();
  }
  [[nodiscard]] double saturatedFraction() const {
    return used > 0 ? static_cast<double>(saturated) / used : 0.0;
  }
};

/// Gauss-Newton system of one state: H = sum w J J^T, b = sum w J r.
struct PoseEquations {
  Matrix8d H = Matrix8d::Zero();
  Vector8d b = Vector8d::Zero();
};

struct LevelResult {
  double rmse = 0;  ///< sqrt(E / n) [grey levels]; NaN when no point is inside the frame
  double saturated_fraction = 0;
  double inside_fraction = 0;  ///< points inside the frame, of all points of the level
  int iterations = 0;
  bool cutoff_raised = false;
  PoseEquations equations;  ///< of the state found
};

/// Direct alignment of one pyramid level: residuals, normal equations and the damped iteration.
/// Owns buffers that are used again from call to call. The bits of the result do not depend on the
/// number of threads.
class PoseAlignment {
 public:
  explicit PoseAlignment(const PinholeCamera& camera, BrightnessModel brightness = {})
      : camera_(camera), brightness_(brightness) {}

  void setCamera(const PinholeCamera& camera) { camera_ = camera; }

  /// @param cutoff larger residuals are saturated [grey levels]
  Evaluation evaluate(const AlignmentLevel& level, const AlignmentState& state, double cutoff);

  /// Of the last state evaluated.
  [[nodiscard]] PoseEquations normalEquations();

  /// Levenberg-Marquardt from `state`, which is left at the lowest energy found.
  LevelResult align(const AlignmentLevel& level, int max_iterations, AlignmentState& state);

 private:
  class Problem;
  struct Samples {
    std::vector<float> u, v, rho, dx, dy, residual, weight;
  };

  void resize(std::size_t points);
  [[nodiscard]] SampleArrays samplesFrom(std::size_t first);
  [[nodiscard]] Evaluation evaluateRaisingCutoff(const AlignmentLevel& level,
                                                 const AlignmentState& state,
                                                 double& cutoff);

  PinholeCamera camera_;
  BrightnessModel brightness_;
  AlignmentSetting setting_{};
  const ReferencePoints* points_ = nullptr;  // of the last evaluation
  Samples samples_;
  std::vector<BlockEnergy> block_energies_;
  std::vector<std::array<float, kAlignmentSums>> block_sums_;
};

}  // namespace dsorb::track
