// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "features/feature_matches.h"
#include "features/grey_image.h"

#include <cstddef>

namespace dsorb {

/// SIFT features of an image: they find a thing again from a side from which ORB's do not, at ten
/// times the price. Their descriptors are 128 floats of length 1, the square roots of SIFT's.
/// @param count at most about so many
/// @source Lowe, Distinctive image features from scale-invariant keypoints, IJCV 2004;
/// Arandjelovic,
///         Zisserman, Three things everyone should know to improve object retrieval, CVPR 2012
Features findScaleFeatures(const GreyImage& image, int count);

/// Distances between their descriptors [-].
Distances scaleDistances(const Features& from, const Features& to);
/// Distance between two of them [-].
float scaleDistance(const Features& from, std::size_t i, const Features& to, std::size_t j);

}  // namespace dsorb
