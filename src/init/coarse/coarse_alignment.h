// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"
#include "dsorb/image/frame.h"
#include "dsorb/image/pyramid.h"
#include "dsorb/options/coarse.h"

#include "estimate/linear_system.h"
#include "image/photometric.h"
#include "image/pixel_selector.h"

#include <Eigen/Core>

#include <cstddef>
#include <cstdint>
#include <vector>

namespace dsorb::init_coarse {

constexpr int kNeighbours = 10;       // nearest points of the level, the point itself among them
constexpr float kPixelOffset = 0.1F;  // [px]; points stand off the pixel centres
constexpr float kSmoothingWeight = 0.8F;     // of the neighbours' median
constexpr float kMinParentCurvature = 0.1F;  // a flatter parent hands nothing down
constexpr float kMinInverseDepth = 1e-3F;    // of what is aligned and handed over

/// Points of one pyramid level of the first frame, structure of arrays. "Trial" values belong to
/// the step under test and become accepted with it.
struct PointLevel {
  std::vector<float> x, y;       ///< [px of the level]
  std::vector<float> reference;  ///< intensities of the pattern, 8 a point
  std::vector<std::int32_t>
      neighbours;                    ///< kNeighbours a point, nearest first; -1: fewer there are
  std::vector<std::int32_t> parent;  ///< point of the next coarser level, -1: none

  std::vector<float> inverse_depth, trial_inverse_depth;  ///< [1/unit]
  std::vector<float> smoothed;                    ///< inverse depth after smoothing: the output
  std::vector<float> energy, trial_energy;        ///< photometric [grey levels^2]
  std::vector<float> curvature, trial_curvature;  ///< of the energy over the inverse depth, half
  std::vector<float> max_step;  ///< inverse depth change that moves the projection by 1 px
  std::vector<std::uint8_t> good, trial_good;

  [[nodiscard]] int size() const { return static_cast<int>(x.size()); }
};

/// Points wanted on a level of an image of width x height at level 0; on coarse levels more than
/// there are pixels, which means all that have some gradient.
[[nodiscard]] int wantedPoints(int level, int width, int height);

/// A level of good points at inverse depth 1, with neighbours and without parents. Pixels too near
/// to the border and those whose pattern touches an invalid pixel are left out.
[[nodiscard]] PointLevel makePointLevel(const PyramidLevel& image,
                                        const std::vector<SelectedPixel>& pixels);

/// Sets each fine point's parent: the nearest coarse point, unless it is too far.
/// @param max_distance [px of the coarse level]; 0: no limit
void findParents(const PointLevel& coarse, double max_distance, PointLevel& fine);

/// All points back to the fronto-parallel plane at inverse depth 1; flags stay.
void flatten(PointLevel& level);

/// Replaces the smoothed inverse depth of good points, in place and in index order, by a mean of
/// their own inverse depth and their good neighbours' median.
void smooth(PointLevel& level);

/// Standard deviation of the good neighbours' own inverse depths about the smoothed one of a point:
/// by about so much smoothing is wrong, where it reaches over an edge of depth. Robust; 0 without
/// enough neighbours.
[[nodiscard]] float neighbourSpread(const PointLevel& level, std::size_t point);

/// Hands inverse depths from a level to the next finer one. The caller smooths the fine level then.
void propagateDown(const PointLevel& coarse, PointLevel& fine);

/// Hands curvature-weighted means of inverse depths to the next coarser level. The caller smooths
/// the coarse level then.
/// @param keep_orphans coarse points without a good child keep their smoothed inverse depth instead
///                     of getting 0, which would leak into their neighbours' medians
void propagateUp(const PointLevel& fine, bool keep_orphans, PointLevel& coarse);

/// Makes bad points with at least one good neighbour good, at the mean of these neighbours.
void reviveFromNeighbours(PointLevel& level);

using Vector8d = Eigen::Matrix<double, 8, 1>;
using Matrix8d = Eigen::Matrix<double, 8, 8>;

/// What is estimated of the newest frame. Parameters and their increments are ordered [translation;
/// rotation; log gain; offset].
struct Alignment {
  SE3 T_cur_ref;
  double log_gain = 0;           ///< I_new = e^log_gain I_ref + offset
  double offset = 0;             ///< [grey levels]
  double exposure_log_gain = 0;  ///< what the exposure times say of log_gain; 0: unknown
  bool snapped = false;          ///< translation has left the prior once
  /// Residuals are divided by the root of the gain, beyond what the exposures say: both images
  /// count alike. With least squares alone the gain falls with the share of the images that does
  /// not match.
  /// @source geometric mean regression, minimum of (I_new - g I_ref - b)^2 / g
  bool balanced = false;
};

/// One level of the newest frame.
struct LevelView {
  const PyramidLevel* image;
  PinholeCamera camera;
};

/// View of one level of a frame.
[[nodiscard]] inline LevelView viewOf(const Frame& frame, const PinholeCamera& camera, int level) {
  return {&frame.level(level), camera.atLevel(level)};
}

/// Quadratic terms on every inverse depth.
struct DepthPull {
  float prior = 0;     ///< weight toward 1
  float coupling = 0;  ///< weight toward the smoothed inverse depth
};

/// Sums over the points of a level.
struct LevelSums {
  double energy = 0;       ///< bad points count with their last accepted one [grey levels^2]
  double good_energy = 0;  ///< of the good points
  int good = 0;
  int inliers = 0;  ///< good with a pattern energy of at most kPatternOutlierEnergy
  LevelSums& operator+=(const LevelSums& other);

  /// Energy in which every point that is not good counts as an outlier.
  [[nodiscard]] double robustEnergy(int points) const {
    return good_energy + static_cast<double>(kPatternOutlierEnergy) * (points - good);
  }
  /// Share of the good points.
  [[nodiscard]] double inlierShare() const {
    return good > 0 ? static_cast<double>(inliers) / good : 0.0;
  }
};

constexpr float kMaxPatternEnergy = 20 * kPatternOutlierEnergy;  // above, the point is bad

/// Evaluates all points of a level at their trial inverse depths: writes trial energy, curvature,
/// flag and the step limit, and the normal equations over the eight parameters and the inverse
/// depths of the good points. Same bits for any number of threads.
/// @param system of the photometric energy; depth terms act on the inverse depths only, whose
///               curvature is 1 more, so that flat regions stay where they are
/// @source residual r = I_new(p') - e^a I_ref(p) - b over the 8-pixel pattern, DSO,
/// arXiv:1607.02565,
///         eq. (4) without gradient weights; Jacobians derived in coarse_residual_test
LevelSums evaluateLevel(const LevelView& view,
                        const Alignment& alignment,
                        const DepthPull& pull,
                        PointLevel& points,
                        LinearSystem<float>& system);

/// What an alignment may change.
enum class Unknowns {
  kAll,      ///< pose, brightness and inverse depths, with the prior and the coupling
  kPose,     ///< pose and brightness
  kRotation  ///< rotation and brightness
};

/// Prior toward no translation and inverse depth 1, over all n points of a level.
/// @source E = w n |t|^2 [+ w sum (depth - 1)^2], at most c n; front end of DSO as published, which
///         has the bracket in the gradient and not in the energy
struct StationaryUnitPlanePrior {
  double energy = 0;
  double weight = 0;  ///< w while below the cap, else 0
  bool capped = false;
};

/// One state: photometric and prior terms together.
struct LevelState {
  LevelSums sums;
  StationaryUnitPlanePrior prior;
  [[nodiscard]] double energy() const { return sums.energy + prior.energy; }
};

/// How one level went.
struct LevelReport {
  int iterations = 0;  ///< steps tried
  LevelState state;    ///< at the accepted estimate
  int points = 0;
  [[nodiscard]] double inlierShare() const { return state.sums.inlierShare(); }
  [[nodiscard]] double visibleShare() const;  ///< good points, of all
};

/// Levenberg-Marquardt on one level: pose and brightness with the inverse depths eliminated (Schur
/// complement). Keeps its buffers, so steady work does not allocate.
/// @source front end of DSO as published; eliminated depths as in Engel et al., arXiv:1607.02565,
///         section 2.3
class LevelAligner {
 public:
  explicit LevelAligner(const CoarseOptions& options) : options_(options) {}

  /// @param max_iterations steps tried are one more at most
  /// @param points         trial inverse depths start from the accepted ones
  /// @param alignment      start value and result
  LevelReport align(const LevelView& view,
                    int max_iterations,
                    Unknowns unknowns,
                    PointLevel& points,
                    Alignment& alignment);

  /// Equations at an estimate, at the points' trial inverse depths.
  LevelState evaluate(const LevelView& view,
                      Unknowns unknowns,
                      PointLevel& points,
                      const Alignment& alignment);

  /// Damped step of pose and brightness from the accepted equations.
  /// @return increment, [translation; rotation; log gain; offset], 0 where nothing may change
  [[nodiscard]] Vector8d solve(Unknowns unknowns, double damping);

  /// Sets the trial inverse depths that belong to a step of solve().
  void stepDepths(const Vector8d& step, PointLevel& points);

  /// Equations of the last evaluation, prior included.
  [[nodiscard]] const LinearSystem<float>& evaluated() const { return trial_; }

  /// Makes the last evaluation the accepted one.
  void accept(PointLevel& points);

 private:
  class Problem;

  [[nodiscard]] StationaryUnitPlanePrior stationaryUnitPlanePrior(const PointLevel& points,
                                                                  const Alignment& alignment) const;
  /// Difference of the coupling energies, trial less accepted.
  [[nodiscard]] double couplingGain(const PointLevel& points,
                                    const LevelState& accepted,
                                    const LevelState& trial,
                                    bool snapped) const;

  CoarseOptions options_;
  LinearSystem<float> accepted_;
  LinearSystem<float> trial_;
  DepthElimination<float> elimination_;
  std::vector<double> depth_step_;
};

/// Smooths the inverse depths of a level, or, before the translation has left the prior, sets the
/// smoothed ones to 1.
void regularize(bool snapped, PointLevel& points);

}  // namespace dsorb::init_coarse
