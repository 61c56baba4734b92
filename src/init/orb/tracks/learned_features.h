// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "init/orb/tracks/features.h"

#include <opencv2/core.hpp>

#include <memory>
#include <string>

namespace dsorb::init_orb {

/// Side of the squares of pixels that a network's outputs have one element for [px].
constexpr int kLearnedCell = 8;

/// Outputs of a network for an image, one element a cell: planes of floats, row by row.
struct LearnedMaps {
  int columns = 0;
  int rows = 0;
  cv::Mat descriptors;  ///< [channel][cell]
  cv::Mat keypoints;    ///< [pixel of the cell, and none of them][cell]: logits
  cv::Mat reliability;  ///< [1][cell], 0 to 1
};

/// Image as a network wants it: sizes are multiples of 32, mean 0, variance 1; what is added
/// continues the image mirrored.
cv::Mat networkInput(const cv::Mat& grey);

/// Features at the maxima of the keypoints' probability, the most probable and reliable first, with
/// the interpolated descriptors.
/// @source Potje, Cadar, Araujo, Martins, Nascimento, XFeat: Accelerated Features for Lightweight
///         Image Matching, CVPR 2024
Features readFeatures(const LearnedMaps& maps, const GreyImage& image, int max_features);

/// Whether this build can run networks (DSORB_WITH_DNN).
[[nodiscard]] bool builtWithDnn();

/// Features of a network.
/// @param file ONNX, as scripts/export_xfeat.py writes it
/// @throws ConfigError where this build cannot run networks
/// @throws IoError     on a file that is no such network
std::unique_ptr<FeatureFinder> makeLearnedFinder(const std::string& file);

}  // namespace dsorb::init_orb
