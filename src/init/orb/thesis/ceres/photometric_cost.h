// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "init/orb/photometric/photometric_problem.h"

#include <ceres/cost_function.h>

namespace dsorb::init_orb {

/// One value a pixel of the pattern.
using PatchVector = Eigen::Matrix<double, kPatternSize, 1>;

/// A later frame at the same level.
struct PatchTarget {
  const PyramidLevel* image = nullptr;
  const PinholeCamera* camera = nullptr;  ///< of the level
  SE3 T_cam_ref;
  BrightnessTransfer transfer;  ///< reference to this frame
};

/// Residuals of one patch in one frame and their derivatives.
struct PatchResidual {
  PatchVector residual;                             ///< [grey levels]
  Eigen::Matrix<double, kPatternSize, 6> J_pose;    ///< of a left increment
  Eigen::Matrix<double, kPatternSize, 2> J_affine;  ///< of a and b of the frame
  PatchVector J_inverse_depth;
  bool inside = false;  ///< the whole pattern inside the image, in front, and valid
};

/// r_j = I(p_j) - model(I_ref,j): psi I_ref with psi = sum I / sum I_ref, which the derivatives
/// hold constant; or gain I_ref + offset. Every pixel of the pattern moves with the inverse depth
/// of the centre; gradients are interpolated central differences.
/// @param inverse_depth of the centre [1/unit]
/// @source [Gladkova], eq. (11) and (12); Engel et al., DSO, eq. (4)
PatchResidual evaluatePatch(const HostPatch& patch,
                            const PatchTarget& target,
                            double inverse_depth,
                            PhotometricBrightness brightness);

/// One frame in the form of the residual.
PatchTarget patchTarget(const PhotometricProblem& problem,
                        const PhotometricState& state,
                        std::size_t frame);

/// One patch in one frame as Ceres sees it: 8 residuals whose squares are the weighted Huber
/// energies of the pixels. Parameters: pose (PoseBlock), with the affine model a and b of the
/// frame, inverse depth.
class PhotometricCost final : public ceres::CostFunction {
 public:
  /// What all patches of one frame share; must outlive the costs.
  struct Setting {
    PatchTarget target;  ///< its pose is not used, its transfer without the affine model only
    PhotometricBrightness brightness = PhotometricBrightness::kAffine;
    double huber_threshold = 9;  ///< [grey levels]
    double reference_exposure = 1;
    double exposure = 1;
  };
  PhotometricCost(const HostPatch& patch, const Setting& setting);

  bool Evaluate(double const* const* parameters,
                double* residuals,
                double** jacobians) const override;

 private:
  const HostPatch& patch_;
  const Setting& setting_;
};

}  // namespace dsorb::init_orb
