// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "estimate/linear_system.h"
#include "init/orb/photometric/photometric_kernels.h"
#include "init/orb/photometric/photometric_problem.h"

#include <Eigen/Core>

#include <cstddef>
#include <vector>

namespace dsorb::init_orb {

/// Robustly weighted normal equations over the frames (pose as left increment, then brightness
/// where it is unknown) and inverse depths.
struct PhotometricEquations {
  LinearSystem<float> system;
  int frame_size = 6;         ///< unknowns of one frame
  std::vector<float> energy;  ///< of each patch, Huber [grey levels^2]
  double cost = 0;            ///< half the sum of the energies
};

/// Sets up the equations again and again; allocates at its construction and at the first
/// evaluation of each result only.
class PhotometricLinearizer {
 public:
  explicit PhotometricLinearizer(const PhotometricProblem& problem);
  /// @param block_begin first patch of each block that is summed in single precision, and the end
  PhotometricLinearizer(const PhotometricProblem& problem, std::vector<std::size_t> block_begin);

  void linearize(const PhotometricState& state, PhotometricEquations& equations);

  /// What one block added to the gradient of the frames in the last evaluation.
  [[nodiscard]] Eigen::VectorXd blockGradient(std::size_t block) const;

 private:
  void prepare(const PhotometricState& state, PhotometricEquations& equations);
  void linearizeBlock(std::size_t block, PhotometricEquations& equations);
  void collect(PhotometricEquations& equations) const;
  [[nodiscard]] std::size_t blocks() const { return block_begin_.size() - 1; }

  const PhotometricProblem& problem_;
  std::vector<std::size_t> block_begin_;
  std::vector<PatchImage> images_;
  std::vector<float> inverse_depth_;
  std::vector<std::array<float, kFrameSums>> sums_;  ///< [block * frames + frame]
};

}  // namespace dsorb::init_orb
