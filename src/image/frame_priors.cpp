// SPDX-License-Identifier: BSD-3-Clause
#include "image/frame_priors.h"

#include "dsorb/image/frame_priors.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>

#include <cmath>
#include <cstddef>
#include <limits>
#include <stdexcept>
#include <string>

namespace dsorb {
namespace {

constexpr double kMaxSkew = 1e-6;   // of a covariance, relative to its largest entry
constexpr double kMaxShear = 1e-3;  // of a rotation matrix in single precision: far less

void require(bool holds, const std::string& expected, double found) {
  if (holds) return;
  throw std::invalid_argument("prior of a frame: expected " + expected + ", found " +
                              std::to_string(found));
}

void requireSigma(double sigma, const std::string& what) {
  require(std::isfinite(sigma) && sigma > 0, "a sigma above 0 of the " + what, sigma);
}

bool isLength(float value) {
  return std::isfinite(value) && value > 0;
}

std::size_t pixelsOf(int width, int height) {
  return static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
}

DepthPrior emptyPrior(int width, int height) {
  DepthPrior prior{width, height, {}, {}};
  prior.depth.assign(pixelsOf(width, height), std::numeric_limits<float>::quiet_NaN());
  prior.sigma.assign(prior.depth.size(), 0);
  return prior;
}

void checkDepth(const DepthPrior& prior, const Frame& frame) {
  require(prior.width == frame.width(), "the frame's width", prior.width);
  require(prior.height == frame.height(), "the frame's height", prior.height);
  checkSize(prior);
  for (std::size_t i = 0; i < prior.depth.size(); ++i) {
    if (!isKnownDepth(prior.depth[i])) continue;
    require(isLength(prior.sigma[i]),
            "a sigma above 0 where the depth is known",
            static_cast<double>(prior.sigma[i]));
  }
}

void checkPose(const PosePrior& prior) {
  const Eigen::Matrix4d T = prior.T_frame_since.matrix();
  require(T.allFinite(), "a finite motion", T.sum());
  const Eigen::Index size = prior.has_translation ? 6 : 3;
  const Eigen::MatrixXd covariance = prior.covariance.bottomRightCorner(size, size);
  require(covariance.allFinite(), "a finite covariance of the motion", covariance.sum());
  const double skew = (covariance - covariance.transpose()).cwiseAbs().maxCoeff();
  require(skew <= kMaxSkew * covariance.cwiseAbs().maxCoeff(),
          "a symmetric covariance of the motion",
          skew);
  const Eigen::LLT<Eigen::MatrixXd> factor(covariance);
  require(factor.info() == Eigen::Success,
          "a positive definite covariance of the motion; smallest entry of its diagonal",
          covariance.diagonal().minCoeff());
}

}  // namespace

bool isKnownDepth(float depth) {
  return isLength(depth);
}

void checkSize(const DepthPrior& prior) {
  const std::size_t pixels = pixelsOf(prior.width, prior.height);
  require(
      prior.depth.size() == pixels, "one depth a pixel", static_cast<double>(prior.depth.size()));
  require(
      prior.sigma.size() == pixels, "one sigma a pixel", static_cast<double>(prior.sigma.size()));
}

DepthPrior denseDepth(const ImageView& depth, double sigma, double relative_sigma) {
  require(!depth.empty(), "a depth image with pixels", 0);
  require(depth.type() == ImageView::Type::kFloat, "a depth image of floats", 8);
  const double both = sigma + relative_sigma;
  require(sigma >= 0 && relative_sigma >= 0 && both > 0 && std::isfinite(both),
          "sigmas of at least 0, one above",
          both);
  DepthPrior prior = emptyPrior(depth.width(), depth.height());
  std::size_t i = 0;
  for (int y = 0; y < prior.height; ++y) {
    const auto* row = depth.row<float>(y);
    for (int x = 0; x < prior.width; ++x, ++i) {
      if (!isKnownDepth(row[x])) continue;
      prior.depth[i] = row[x];
      const double proportional = relative_sigma * static_cast<double>(row[x]);
      prior.sigma[i] = static_cast<float>(std::hypot(sigma, proportional));
    }
  }
  return prior;
}

DepthPrior sparseDepth(int width, int height, const std::vector<DepthAtPixel>& samples) {
  require(width > 0, "a width above 0", width);
  require(height > 0, "a height above 0", height);
  DepthPrior prior = emptyPrior(width, height);
  for (const DepthAtPixel& sample : samples) {
    require(isLength(sample.depth), "a depth above 0", static_cast<double>(sample.depth));
    require(isLength(sample.sigma), "a sigma above 0", static_cast<double>(sample.sigma));
    const float x = std::round(sample.x);
    const float y = std::round(sample.y);
    const bool inside =
        x >= 0 && y >= 0 && x < static_cast<float>(width) && y < static_cast<float>(height);
    if (!inside) continue;
    const std::size_t i =
        static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x);
    if (prior.depth[i] <= sample.depth) continue;  // false where none is known
    prior.depth[i] = sample.depth;
    prior.sigma[i] = sample.sigma;
  }
  return prior;
}

PosePrior rotationSince(FrameId since,
                        const Eigen::Matrix3d& R_frame_since,
                        const Eigen::Matrix3d& covariance) {
  const double error =
      (R_frame_since * R_frame_since.transpose() - Eigen::Matrix3d::Identity()).norm();
  require(
      error < kMaxShear && R_frame_since.determinant() > 0, "a rotation, with R R^T near 1", error);
  PosePrior prior;
  prior.since = since;
  prior.T_frame_since = SE3(R_frame_since, Eigen::Vector3d::Zero());
  prior.covariance.bottomRightCorner<3, 3>() = covariance;
  return prior;
}

PosePrior rotationSince(FrameId since, const Eigen::Matrix3d& R_frame_since, double sigma) {
  requireSigma(sigma, "rotation");
  return rotationSince(
      since, R_frame_since, Eigen::Matrix3d(sigma * sigma * Eigen::Matrix3d::Identity()));
}

PosePrior poseSince(FrameId since, const SE3& T_frame_since, const Matrix6d& covariance) {
  return {since, T_frame_since, covariance, true};
}

void checkPriors(const Frame& frame) {
  if (frame.priors() == nullptr) return;
  const FramePriors& priors = *frame.priors();
  if (priors.depth) checkDepth(*priors.depth, frame);
  if (priors.pose) checkPose(*priors.pose);
  if (priors.distance) {
    requireSigma(priors.distance->sigma, "distance");
    require(priors.distance->metres >= 0 && std::isfinite(priors.distance->metres),
            "a distance of at least 0",
            priors.distance->metres);
  }
}

}  // namespace dsorb
