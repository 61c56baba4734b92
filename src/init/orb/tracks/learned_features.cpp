// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/tracks/learned_features.h"

#include <opencv2/imgproc.hpp>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <vector>

namespace dsorb::init_orb {
namespace {

constexpr int kMultiple = 32;             // of a network's input sizes [px]
constexpr float kMinProbability = 0.05F;  // of a keypoint
constexpr int kSuppression = 2;           // around a maximum nothing is larger [px]
constexpr double kLeastDeviation = 1e-3;  // of the grey levels: an image without content
constexpr int kCellPixels = kLearnedCell * kLearnedCell;

/// Probability that a keypoint is at each pixel: softmax over the pixels of a cell and none.
cv::Mat probabilities(const LearnedMaps& maps) {
  cv::Mat heat(maps.rows * kLearnedCell, maps.columns * kLearnedCell, CV_32F);
  for (int cell = 0; cell < maps.rows * maps.columns; ++cell) {
    std::array<float, kCellPixels + 1> logits{};
    for (int k = 0; k <= kCellPixels; ++k) {
      logits[static_cast<std::size_t>(k)] = maps.keypoints.ptr<float>(k)[cell];
    }
    const float largest = *std::max_element(logits.begin(), logits.end());
    float sum = 0;
    for (float& value : logits) sum += value = std::exp(value - largest);
    const int top = cell / maps.columns * kLearnedCell;
    const int left = cell % maps.columns * kLearnedCell;
    for (int k = 0; k < kCellPixels; ++k) {
      heat.at<float>(top + k / kLearnedCell, left + k % kLearnedCell) =
          logits[static_cast<std::size_t>(k)] / sum;
    }
  }
  return heat;
}

/// Weights of four neighbours at a fraction, cubic convolution with a = -0.75.
std::array<float, 4> cubicWeights(float t) {
  constexpr float kA = -0.75F;
  const auto inner = [](float x) { return ((kA + 2) * x - (kA + 3)) * x * x + 1; };
  const auto outer = [](float x) { return ((kA * x - 5 * kA) * x + 8 * kA) * x - 4 * kA; };
  return {outer(1 + t), inner(t), inner(1 - t), outer(2 - t)};
}

/// Adds a plane's cells around a place, weighted. @param x, y of the place [cells]
float interpolateCubic(const float* plane, const LearnedMaps& maps, float x, float y) {
  const auto left = static_cast<int>(std::floor(x));
  const auto top = static_cast<int>(std::floor(y));
  const std::array<float, 4> across = cubicWeights(x - static_cast<float>(left));
  const std::array<float, 4> down = cubicWeights(y - static_cast<float>(top));
  float sum = 0;
  for (int r = 0; r < 4; ++r) {
    const int row = std::clamp(top - 1 + r, 0, maps.rows - 1);
    for (int c = 0; c < 4; ++c) {
      const int column = std::clamp(left - 1 + c, 0, maps.columns - 1);
      sum += down[static_cast<std::size_t>(r)] * across[static_cast<std::size_t>(c)] *
             plane[row * maps.columns + column];
    }
  }
  return sum;
}

/// Coordinate in cells of a pixel's: centres of cells are whole numbers.
float inCells(float pixel) {
  return (pixel + 0.5F) / kLearnedCell - 0.5F;
}

std::vector<cv::KeyPoint> strongestScores(const LearnedMaps& maps, const GreyImage& image) {
  const cv::Mat heat = probabilities(maps);
  cv::Mat largest;
  cv::dilate(heat, largest, cv::Mat::ones(2 * kSuppression + 1, 2 * kSuppression + 1, CV_8UC1));
  std::vector<cv::KeyPoint> points;
  for (int y = 0; y < image.grey.rows; ++y) {
    for (int x = 0; x < image.grey.cols; ++x) {
      const float probability = heat.at<float>(y, x);
      if (!(probability > kMinProbability) || probability < largest.at<float>(y, x)) continue;
      const cv::Point2f place(static_cast<float>(x), static_cast<float>(y));
      if (!image.usable(place)) continue;
      const float reliability =
          interpolateCubic(maps.reliability.ptr<float>(), maps, inCells(place.x), inCells(place.y));
      points.emplace_back(
          place, static_cast<float>(kLearnedCell), -1.0F, probability * reliability);
    }
  }
  return points;
}

/// Every cell's descriptor with length one.
cv::Mat normalized(const LearnedMaps& maps) {
  cv::Mat descriptors = maps.descriptors.clone();
  for (int cell = 0; cell < descriptors.cols; ++cell) {
    const double length = cv::norm(descriptors.col(cell));
    if (length > 0) descriptors.col(cell) *= 1 / length;
  }
  return descriptors;
}

}  // namespace

cv::Mat networkInput(const cv::Mat& grey) {
  const auto added = [](int size) { return (kMultiple - size % kMultiple) % kMultiple; };
  cv::Scalar mean;
  cv::Scalar deviation;
  cv::meanStdDev(grey, mean, deviation);
  const double scale = 1 / std::max(deviation[0], kLeastDeviation);
  cv::Mat input;
  grey.convertTo(input, CV_32F, scale, -mean[0] * scale);
  cv::copyMakeBorder(input, input, 0, added(grey.rows), 0, added(grey.cols), cv::BORDER_REFLECT);
  return input;
}

Features readFeatures(const LearnedMaps& maps, const GreyImage& image, int max_features) {
  Features features;
  features.points = strongestScores(maps, image);
  std::sort(features.points.begin(), features.points.end(), stronger);
  const auto most = static_cast<std::size_t>(max_features);
  if (features.points.size() > most) features.points.resize(most);
  const cv::Mat planes = normalized(maps);
  features.descriptors.create(static_cast<int>(features.points.size()), planes.rows, CV_32F);
  for (int i = 0; i < features.descriptors.rows; ++i) {
    const cv::Point2f& place = features.points[static_cast<std::size_t>(i)].pt;
    auto* row = features.descriptors.ptr<float>(i);
    for (int k = 0; k < planes.rows; ++k) {
      row[k] = interpolateCubic(planes.ptr<float>(k), maps, inCells(place.x), inCells(place.y));
    }
    cv::Mat descriptor = features.descriptors.row(i);
    cv::normalize(descriptor, descriptor);
  }
  return features;
}

}  // namespace dsorb::init_orb
