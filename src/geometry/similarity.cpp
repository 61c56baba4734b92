// SPDX-License-Identifier: BSD-3-Clause
#include "geometry/similarity.h"

#include <Eigen/LU>
#include <Eigen/SVD>

#include <cmath>
#include <limits>
#include <stdexcept>
#include <string>

namespace dsorb {
namespace {

constexpr std::size_t kFewestPoints = 3;

Eigen::Vector3d mean(const std::vector<Eigen::Vector3d>& points) {
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  for (const Eigen::Vector3d& point : points) sum += point;
  return sum / static_cast<double>(points.size());
}

void requireSameSize(const std::vector<Eigen::Vector3d>& from,
                     const std::vector<Eigen::Vector3d>& to,
                     std::size_t fewest) {
  if (from.size() == to.size() && from.size() >= fewest) return;
  throw std::invalid_argument("similarity: needs equally many points, at least " +
                              std::to_string(fewest) + ", got " + std::to_string(from.size()) +
                              " and " + std::to_string(to.size()));
}

}  // namespace

Similarity alignPoints(const std::vector<Eigen::Vector3d>& from,
                       const std::vector<Eigen::Vector3d>& to) {
  requireSameSize(from, to, kFewestPoints);
  const Eigen::Vector3d from_mean = mean(from);
  const Eigen::Vector3d to_mean = mean(to);
  Eigen::Matrix3d covariance = Eigen::Matrix3d::Zero();
  double variance = 0;
  for (std::size_t i = 0; i < from.size(); ++i) {
    covariance += (to[i] - to_mean) * (from[i] - from_mean).transpose();
    variance += (from[i] - from_mean).squaredNorm();
  }
  const double rounding = std::numeric_limits<double>::epsilon() * from_mean.norm();
  if (!(variance > static_cast<double>(from.size()) * rounding * rounding)) {
    throw std::invalid_argument("similarity: all " + std::to_string(from.size()) +
                                " points coincide, variance " + std::to_string(variance));
  }
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(covariance,
                                              Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Vector3d signs = Eigen::Vector3d::Ones();
  if (svd.matrixU().determinant() * svd.matrixV().determinant() < 0) signs.z() = -1;
  Similarity to_from;
  to_from.rotation = svd.matrixU() * signs.asDiagonal() * svd.matrixV().transpose();
  to_from.scale = svd.singularValues().dot(signs) / variance;
  to_from.translation = to_mean - to_from.scale * (to_from.rotation * from_mean);
  return to_from;
}

double alignmentRms(const Similarity& to_from,
                    const std::vector<Eigen::Vector3d>& from,
                    const std::vector<Eigen::Vector3d>& to) {
  requireSameSize(from, to, 1);
  double sum = 0;
  for (std::size_t i = 0; i < from.size(); ++i) sum += (to[i] - to_from * from[i]).squaredNorm();
  return std::sqrt(sum / static_cast<double>(from.size()));
}

}  // namespace dsorb
