// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"

#include "estimate/host_patch.h"
#include "published/structure.h"

#include <Eigen/Core>

#include <cstddef>
#include <vector>

namespace dsorb::published {

/// Patches of the reference at one pyramid level and the frames they are compared with.
struct PhotometricProblem {
  /// Takes the points whose pattern lies inside the reference.
  PhotometricProblem(const Map& map, const PinholeCamera& full, int level);

  PinholeCamera camera;                     ///< of the level
  std::vector<const PyramidLevel*> images;  ///< of all frames
  std::vector<HostPatch> patches;
  std::vector<std::size_t> points;  ///< by patch: index into Map::points
};

/// One value a pixel of the pattern.
using PatchVector = Eigen::Matrix<double, kPatternSize, 1>;

/// Residuals of one patch in one frame and their derivatives.
struct PatchResidual {
  PatchVector value;                              ///< [grey levels]
  Eigen::Matrix<double, kPatternSize, 6> J_pose;  ///< of a left increment
  PatchVector J_inverse_depth;
  double psi = 1;       ///< eq. (12)
  bool inside = false;  ///< the whole pattern inside the image, in front, and valid
};

/// r_j = I_k(p_j) - psi I_ref,j with psi = sum I_k / sum I_ref, which the derivatives hold
/// constant. Every pixel of the pattern moves with the inverse depth of the centre; gradients are
/// interpolated central differences; outside of the image values of the border are repeated.
/// @param frame index into PhotometricProblem::images
/// @source [Gladkova], eq. (11) and (12)
PatchResidual evaluatePatch(const PhotometricProblem& problem,
                            std::size_t patch,
                            std::size_t frame,
                            const SE3& T_cam_ref,
                            double inverse_depth);

/// Residuals of all patches in one frame of the map. Runs in parallel inside the caller's arena.
std::vector<PatchResidual> residualsOf(const PhotometricProblem& problem,
                                       const Map& map,
                                       std::size_t frame);

/// Adjusts poses and the inverse depths of all points to the grey values of the images by Ceres.
/// Afterwards the mean inverse depth is 1.
/// @param map adjusted geometrically, with points
/// @return    whether that gave numbers, a lower cost and enough residuals inside; else the map is
///            as before
/// @source [Gladkova], section 3.4, eq. (10) to (12)
bool performPhotometricBA(Map& map, const PinholeCamera& camera);

/// Removes points that do not fit after a photometric adjustment: a pixel is an outlier when its
/// residual exceeds a quantile of its frame's t-distribution, an observation when more than half of
/// its pixels are, and a point when fewer than two observations remain (or fewer than there are
/// frames).
/// @source [Gladkova], section 3.4
void removeOutliers(Map& map, const PinholeCamera& camera);

/// Scale of greatest likelihood of a t-distribution with five degrees of freedom around zero: its
/// sigma, not its standard deviation. Residuals farther from the median than 3 times 1.4826 MAD
/// have no part.
/// @source [Gladkova], eq. (13) and (14): sigma^2 = mean of w r^2, w = (nu + 1) / (nu + r^2 /
/// sigma^2)
double fitTDistribution(const std::vector<double>& residuals);

}  // namespace dsorb::published
