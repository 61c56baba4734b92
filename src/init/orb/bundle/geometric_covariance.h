// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/options/orb_mapping.h"
#include "dsorb/options/skip.h"

#include "estimate/linear_system.h"
#include "estimate/marginals.h"
#include "init/orb/bundle/reprojection_equations.h"
#include "init/orb/map/initial_map.h"

#include <Eigen/Core>

#include <cstddef>
#include <functional>
#include <optional>

namespace dsorb::init_orb {

/// Adds the gradient by all unknowns of the frames that the error of an observation contributes, of
/// that by a left increment of its frame's pose.
using AddGradient = std::function<void(
    std::size_t observation, const Vector6d& by_pose, Eigen::Ref<Eigen::VectorXd> all)>;

/// Gradients summed over the corners of each cell of the image, inverse depths eliminated, one
/// column a cell: they are independent samples of an error whose covariance is unknown.
Eigen::MatrixXd cellGradients(const InitialMap& map,
                              const LinearSystem<double>& system,
                              const PinholeCamera& camera,
                              const GeometricOptions& options,
                              const AddGradient& add);

/// Marginals of an adjusted map.
struct GeometricMarginals {
  GeometricMarginals(const InitialMap& map,
                     const PinholeCamera& camera,
                     const GeometricOptions& options);

  UnknownRows rows;
  ReprojectionEquations equations;
  Eigen::VectorXd scale;  ///< of UnknownRows; zeros where the map's scale is known
  Marginals marginals;
  /// A-posteriori: sum w e^2 / (observations - parameters) [-]; none without redundancy, or where
  /// the equations do not determine every corner and pose.
  std::optional<double> variance_factor;
};

/// Sets the covariance of every posed frame after the reference, the joint one of all of them and
/// the variance of every corner from their Marginals, times the a-posteriori variance factor
/// s^2 = sum w e^2 / (observations - parameters) of the whitened errors e.
///
/// Tracks share the reference patch and the calibration, neighbours share more: the clustered
/// covariance over cells of the image is added, and the part of the variance that an inverse depth
/// has of its own counts once for all frames. Errors that are no noise (occlusions, wrong warps) do
/// not average out over cells either, and show in the tails of the errors: the clustered covariance
/// is multiplied by 1 + variance_factors::kStartTail * tailExcess, kept in
/// `map.cluster_variance_scale`.
/// @param map adjusted, mean inverse depth 1, every corner observed in a posed frame
/// @return the variance factor s^2 [-]; nothing is set and NaN returned when the problem has no
///         redundancy or is degenerate
double setCovariances(InitialMap& map,
                      const PinholeCamera& camera,
                      const GeometricOptions& options,
                      const Skips& skip = {});

/// The same of a given covariance of the frames' unknowns before the gauge.
/// @param roots      columns r with sum of r r^T = that covariance
/// @param own_factor on the variances that the inverse depths have of their own
void setCovariances(InitialMap& map,
                    const GeometricMarginals& joint,
                    const Eigen::MatrixXd& roots,
                    double own_factor);

}  // namespace dsorb::init_orb
