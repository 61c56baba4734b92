// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "init/orb/photometric/photometric_kernels.h"
#include "init/orb/photometric/photometric_problem.h"

#include <Eigen/Core>

#include <cstddef>
#include <vector>

namespace dsorb::init_orb {

/// Robustly weighted normal equations over the frames (pose as left increment, then brightness
/// where it is unknown) and inverse depths: [H, C; C^T, diag(h)].
struct PhotometricEquations {
  int frame_size = 6;                 ///< unknowns of one frame
  std::size_t stride = 0;             ///< of `coupling`, frames * frame_size rounded up to 8 lanes
  Eigen::MatrixXd hessian;            ///< of the frames, block diagonal
  Eigen::VectorXd gradient;           ///< sum w J^T r
  std::vector<float> coupling;        ///< by patch
  std::vector<float> depth_hessian;   ///< 0 where a patch takes part nowhere
  std::vector<float> depth_gradient;  ///<
  std::vector<float> energy;          ///< of each patch, Huber [grey levels^2]
  double cost = 0;                    ///< half the sum of the energies

  /// Couplings of one patch with all frames.
  [[nodiscard]] Eigen::Map<const Eigen::VectorXf> couplingOf(std::size_t patch) const {
    return {coupling.data() + patch * stride, hessian.rows()};
  }
};

/// Takes the inverse depths out of the equations: subtracts the sum of c c^T / h from `matrix`, of
/// which the lower triangle is written, and that of c b / h from `right`. Runs in parallel inside
/// the caller's arena; the order of the sums does not depend on it.
class DepthElimination {
 public:
  explicit DepthElimination(std::size_t patches)
      : blocks_((patches + kPatchBlock - 1) / kPatchBlock) {}

  /// @param inverse 1 / h by patch, 0 where the patch is left out
  void subtract(const PhotometricEquations& equations,
                const std::vector<float>& inverse,
                Eigen::MatrixXd& matrix,
                Eigen::VectorXd& right);

 private:
  std::size_t blocks_;
  std::vector<float> partial_;  ///< by block: matrix, then vector
};

/// Sets up the equations again and again; allocates at its construction and at the first
/// evaluation of each result only.
class PhotometricLinearizer {
 public:
  PhotometricLinearizer(const PhotometricProblem& problem, const PhotometricOptions& options);
  /// @param block_begin first patch of each block that is summed in single precision, and the end
  PhotometricLinearizer(const PhotometricProblem& problem,
                        const PhotometricOptions& options,
                        std::vector<std::size_t> block_begin);

  void linearize(const PhotometricState& state, PhotometricEquations& equations);

  /// What one block added to PhotometricEquations::gradient in the last evaluation.
  [[nodiscard]] Eigen::VectorXd blockGradient(std::size_t block) const;

 private:
  void prepare(const PhotometricState& state, PhotometricEquations& equations);
  void linearizeBlock(std::size_t block, PhotometricEquations& equations);
  void collect(PhotometricEquations& equations) const;
  [[nodiscard]] std::size_t blocks() const { return block_begin_.size() - 1; }

  const PhotometricProblem& problem_;
  PhotometricOptions options_;
  std::vector<std::size_t> block_begin_;
  std::vector<PatchSetting> settings_;
  std::vector<float> inverse_depth_;
  std::vector<std::array<float, kFrameSums>> sums_;  ///< [block * frames + frame]
};

}  // namespace dsorb::init_orb
