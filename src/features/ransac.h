// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <opencv2/calib3d.hpp>

#include <cstdint>
#include <vector>

namespace dsorb {

/// OpenCV's RANSAC with local optimisation, adaptive rounds and a seed; the same result for any
/// number of threads.
/// @param threshold of an inlier [px]
/// @source Chum, Matas, Kittler, Locally Optimized RANSAC, DAGM 2003
inline cv::UsacParams ransacParameters(double threshold, int max_rounds, std::uint64_t seed) {
  cv::UsacParams parameters;
  parameters.confidence = 0.999;  // that it has met a sample without outliers
  parameters.isParallel = false;  // the order of rounds would depend on the threads
  parameters.loIterations = 5;
  parameters.loMethod = cv::LOCAL_OPTIM_INNER_LO;
  parameters.loSampleSize = 14;
  parameters.maxIterations = max_rounds;
  parameters.neighborsSearch = cv::NEIGH_GRID;
  parameters.randomGeneratorState = static_cast<int>(seed & 0x7FFFFFFFU);
  parameters.sampler = cv::SAMPLING_UNIFORM;
  parameters.score = cv::SCORE_METHOD_MSAC;
  parameters.threshold = threshold;
  return parameters;
}

inline std::vector<cv::Point2d> toCv(const std::vector<Eigen::Vector2d>& points) {
  std::vector<cv::Point2d> out;
  out.reserve(points.size());
  for (const Eigen::Vector2d& point : points) out.emplace_back(point.x(), point.y());
  return out;
}

inline cv::Matx33d toCv(const Eigen::Matrix3d& m) {
  return {m(0, 0), m(0, 1), m(0, 2), m(1, 0), m(1, 1), m(1, 2), m(2, 0), m(2, 1), m(2, 2)};
}

/// @param matrix 3x3 of doubles
inline Eigen::Matrix3d toEigen(const cv::Mat& matrix) {
  return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(matrix.ptr<double>());
}

}  // namespace dsorb
