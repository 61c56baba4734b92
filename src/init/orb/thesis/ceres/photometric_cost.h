// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "init/orb/photometric/photometric_problem.h"

#include <ceres/cost_function.h>

namespace dsorb::init_orb {

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
