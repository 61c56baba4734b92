// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/image/frame_priors.h"
#include "dsorb/init/result.h"

#include <optional>

namespace dsorb {

/// Depth that the caller knows of the reference's image: RGB-D, a network, LiDAR points entered at
/// the pixels they fall on. A depth's standard deviation is hypot(sigma, relative_sigma * depth).
struct KnownDepth {
  ImageView depth;            ///< float, along the optical axis [m]; not above 0 or NaN: not known
  double sigma = 0;           ///< constant part [m]
  double relative_sigma = 0;  ///< proportional part [-]
};

/// Distance between the camera centres of the reference and another posed frame.
struct KnownDistance {
  FrameId frame;      ///< the other one
  double metres = 0;  ///< above 0 [m]
  double sigma = 0;   ///< standard deviation [m]
};

/// Unit of a start from known depths at its reference's points: robust mean of the logarithms of
/// known over estimated depths. Its sigma is measured from their scatter, errors of a cell of the
/// image counting as one; the claimed ones only weigh. It is that of the mean depth alone: it has
/// neither an error that the known depths share nor the one that poses and estimated depths have in
/// common. A camera's distance has the covariance of its pose besides.
/// @return nothing with fewer than 20 depths, or where most of them are off by more than three
/// times
///         what they and the points claim
/// @throws std::invalid_argument on an image that is not float or not of the reference's size, and
///         where sigmas are negative, not finite or both 0
[[nodiscard]] std::optional<MetricScale> scaleFromDepth(const InitializationResult& result,
                                                        const KnownDepth& known);

/// The same with a deviation of its own for every depth, as a frame's priors have it; its sigma has
/// the claimed ones besides, errors of a cell of the image counting as one.
[[nodiscard]] std::optional<MetricScale> scaleFromDepth(const InitializationResult& result,
                                                        const DepthPrior& prior);

/// Unit of a start from a known distance; its sigma has that of the distance and that of the pose.
/// @return nothing where the frame has no pose or no covariance, or has not moved
/// @throws std::invalid_argument where distance or sigma is not above 0 and finite
[[nodiscard]] std::optional<MetricScale> scaleFromDistance(const InitializationResult& result,
                                                           const KnownDistance& known);

/// Unit of a start from the distances and translations that its frames have as priors: the quotient
/// that noise of neither the priors nor the poses biases, over those between posed frames; motions
/// that contradicted the images are left out. Its sigma has those of the priors and that of the
/// newest pose.
/// @return nothing without such a prior, or where the camera has not moved farther than they know
[[nodiscard]] std::optional<MetricScale> scaleFromDistances(const InitializationResult& result);

/// Changes the unit to metres: poses, inverse depths, their covariances and `metric`. The mean
/// inverse depth is no longer 1, as Odometry's initializers promise: for back ends of one's own.
/// @throws std::invalid_argument on a scale that is not above 0 and finite
void toMetres(const MetricScale& scale, InitializationResult& result);

}  // namespace dsorb
