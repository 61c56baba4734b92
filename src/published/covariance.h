// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"

#include "published/map.h"

namespace dsorb::published {

constexpr double kCornerHuber = 2.4474;  ///< sqrt(5.99): 95 % of chi-square, 2 degrees of freedom

/// Sets the covariances of frames and the variances of corners, which the thesis does not hand
/// over: marginals of the geometric adjustment in the gauge "reference pose and mean inverse depth
/// fixed", times the a-posteriori variance factor.
///
/// Tracks share the reference patch and the calibration, neighbours share more: the covariance by
/// cells of the image is added, and the part of the variance that an inverse depth has of its own
/// counts once for all frames. Errors that are no noise (occlusions, wrong warps) do not average
/// out over cells either, and show in the tails of the errors: they widen the covariance by cells.
/// @param map adjusted, mean inverse depth 1
/// @return false where the problem has no redundancy or is degenerate; nothing is set then
bool setGeometricCovariances(Map& map, const PinholeCamera& camera);

/// The same by the photometric adjustment, for all points.
bool setPhotometricCovariances(Map& map, const PinholeCamera& camera);

}  // namespace dsorb::published
