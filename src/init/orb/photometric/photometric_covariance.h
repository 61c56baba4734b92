// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "estimate/marginals.h"
#include "init/orb/photometric/photometric_equations.h"
#include "init/orb/photometric/photometric_problem.h"

#include <Eigen/Core>

#include <array>
#include <optional>
#include <vector>

namespace dsorb::init_orb {

/// Gradients of the reference at the pixels of a patch.
struct PatchGradients {
  std::array<float, kPatternSize> x{};  ///< [grey levels / px]
  std::array<float, kPatternSize> y{};
};
PatchGradients hostGradients(const HostPatch& patch, const PyramidLevel& reference);

/// Marginals of the photometric solution, in the gauge "reference pose and mean inverse depth
/// fixed". Runs in parallel inside the caller's arena.
class PhotometricMarginals {
 public:
  PhotometricMarginals(const PhotometricProblem& problem, const PhotometricState& state);

  /// Whether the equations determine their solution; nothing else may be asked when not.
  [[nodiscard]] bool usable() const { return usable_; }
  /// By patch: s^2 (1 / h + g^T S^- g) [1/unit^2], g = - d inverse depth / d frames,
  /// s^2 = sum w r^2 / degrees of freedom [grey levels^2]; 0 unknown.
  [[nodiscard]] Eigen::VectorXd formalVariances() const;
  /// By patch: max(s^2, s_i^2) / h + g^T poses g [1/unit^2]; 0 unknown.
  /// @param poses covariance of the poses, 6 a frame
  [[nodiscard]] Eigen::VectorXd variances(const Eigen::MatrixXd& poses) const;
  /// Joint covariance of the poses, 6 a frame, robust against clustered errors: those of pixels
  /// close together are not independent, so the gradient of the cost is summed over cells of the
  /// image and the spread of these sums taken as it is.
  /// @source docs/experiments.md, "Variances of depths and poses"; White, A Heteroskedasticity-
  ///         Consistent Covariance Matrix Estimator, Econometrica 1980, with clusters
  [[nodiscard]] Eigen::MatrixXd clusteredPoseCovariance() const;
  /// What the images have a say in: 1 where nothing is known of a patch, near 0 where it is known
  /// better than the images can tell [-].
  [[nodiscard]] double imageShare(std::size_t patch) const { return 1 - knownShare(patch); }

 private:
  /// By patch: own(patch) / h + g^T frames g; 0 unknown. @param frames covariance of all unknowns
  template <typename Own>
  [[nodiscard]] Eigen::VectorXd variancesWith(const Eigen::MatrixXd& frames, Own&& own) const;
  void countResiduals();
  /// Share of a patch's curvature that its known inverse depth has [-].
  [[nodiscard]] double knownShare(std::size_t patch) const;
  /// Variance of a residual where part of them is that of a known inverse depth [grey levels^2].
  [[nodiscard]] double mixedVariance(std::size_t patch, double of_images) const;

  const PhotometricProblem& problem_;
  const PhotometricState& state_;
  PhotometricEquations equations_;
  std::vector<int> observations_;  ///< by patch
  Marginals marginals_;
  double noise_variance_ = 0;
  bool usable_ = false;
};

/// An adjusted map with the variances of its corners and semi-dense points, and with the
/// covariances of its poses where the photometric ones were taken.
/// @param problem     the map's
/// @param poses_moved the poses are the photometric ones, not those of the corners
/// @return nothing when the equations are degenerate
std::optional<InitialMap> withPhotometricVariances(InitialMap map,
                                                   PhotometricProblem problem,
                                                   bool poses_moved);

}  // namespace dsorb::init_orb
