// SPDX-License-Identifier: BSD-3-Clause
#include "features/scale_features.h"

#include <Eigen/Core>
#include <opencv2/features2d.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>

namespace dsorb {
namespace {

constexpr int kOctaveLayers = 3;
constexpr double kContrast = 0.01;  // of a feature to what is around it, of the grey levels [-]

using Descriptors = Eigen::Matrix<float, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;

Eigen::Map<const Descriptors> matrixOf(const Features& features) {
  const cv::Mat& rows = features.descriptors;
  return {rows.ptr<float>(), rows.rows, rows.cols};
}

}  // namespace

Features findScaleFeatures(const GreyImage& image, int count) {
  Features features;
  const cv::Ptr<cv::SIFT> detector = cv::SIFT::create(count, kOctaveLayers, kContrast);
  detector->detectAndCompute(image.grey, image.valid, features.points, features.descriptors);
  for (int i = 0; i < features.descriptors.rows; ++i) {
    Eigen::Map<Eigen::ArrayXf> row(features.descriptors.ptr<float>(i), features.descriptors.cols);
    row = (row / row.sum()).sqrt();
  }
  return features;
}

Distances scaleDistances(const Features& from, const Features& to) {
  Distances distances(from.points.size(), to.points.size());
  if (from.points.empty() || to.points.empty()) return distances;
  const Descriptors cosines = matrixOf(from) * matrixOf(to).transpose();
  Eigen::Map<Descriptors>(distances.row(0), cosines.rows(), cosines.cols()) =
      (2 - 2 * cosines.array()).max(0.0F).sqrt().matrix();
  return distances;
}

float scaleDistance(const Features& from, std::size_t i, const Features& to, std::size_t j) {
  const float cosine = matrixOf(from)
                           .row(static_cast<Eigen::Index>(i))
                           .dot(matrixOf(to).row(static_cast<Eigen::Index>(j)));
  return std::sqrt(std::max(2 - 2 * cosine, 0.0F));
}

}  // namespace dsorb
