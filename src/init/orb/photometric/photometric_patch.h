// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"
#include "dsorb/image/affine_brightness.h"
#include "dsorb/image/pyramid.h"
#include "dsorb/options/orb_mapping.h"

#include "estimate/host_patch.h"

#include <Eigen/Core>

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

}  // namespace dsorb::init_orb
