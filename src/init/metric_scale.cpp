// SPDX-License-Identifier: BSD-3-Clause
#include "dsorb/init/metric_scale.h"

#include "base/median.h"
#include "estimate/robust_loss.h"
#include "image/cell_grid.h"
#include "image/frame_priors.h"
#include "init/result.h"

#include <Eigen/LU>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <set>
#include <stdexcept>
#include <string>

namespace dsorb {
namespace {

constexpr std::size_t kMinDepths = 20;
constexpr double kMinAgreeing = .5;  // share of depths that make a scale
constexpr double kMinSpread = 1e-3;  // of logarithms: floats rounded to millimetres
constexpr double kOutlier = 3;       // standard deviations
constexpr int kRounds = 20;          // of reweighting

/// Logarithm of metres over unit by one depth.
struct LogRatio {
  double value = 0;
  double sigma = 0;  // as claimed
  std::size_t cell = 0;
};

void require(bool holds, const char* expected, double value) {
  if (holds) return;
  throw std::invalid_argument("metric scale: expected " + std::string(expected) + ", found " +
                              std::to_string(value));
}

void check(const InitializationResult& result, const KnownDepth& known) {
  require(!known.depth.empty(), "a depth image with pixels", 0);
  require(known.depth.type() == ImageView::Type::kFloat, "a depth image of floats", 8);
  const Frame& reference = *result.frames.at(0).frame;
  require(known.depth.width() == reference.width(), "the reference's width", known.depth.width());
  require(
      known.depth.height() == reference.height(), "the reference's height", known.depth.height());
  const double both = known.sigma + known.relative_sigma;
  require(known.sigma >= 0 && known.relative_sigma >= 0 && both > 0 && std::isfinite(both),
          "sigmas of at least 0, one above",
          both);
}

/// @param known  depths [m], not above 0 or NaN: not known
/// @param sigma  relative standard deviation of a depth at a pixel: x, y, depth
template <typename Sigma>
std::vector<LogRatio> logRatios(const InitializationResult& result,
                                const ImageView& known,
                                Sigma&& sigma) {
  const CellGrid cells = errorCells(known.width(), known.height());
  std::vector<LogRatio> ratios;
  for (const InitPoint& point : result.points) {
    if (point.host != 0) continue;
    const auto x = static_cast<int>(std::lround(point.pixel.x()));
    const auto y = static_cast<int>(std::lround(point.pixel.y()));
    if (x < 0 || y < 0 || x >= known.width() || y >= known.height()) continue;
    if (!isKnownDepth(known.row<float>(y)[x])) continue;
    const double depth = known.row<float>(y)[x];
    const double of_depth = sigma(x, y, depth);
    const double of_point = std::sqrt(point.variance) / point.inverse_depth;
    ratios.push_back({std::log(depth * point.inverse_depth),
                      std::hypot(of_depth, of_point),
                      cells.at(point.pixel.x(), point.pixel.y())});
  }
  return ratios;
}

/// Standard deviation of errors over claimed sigmas; at least what rounding leaves.
double spreadAround(double mean, const std::vector<LogRatio>& ratios) {
  std::vector<double> errors;
  errors.reserve(ratios.size());
  for (const LogRatio& ratio : ratios) {
    errors.push_back(std::abs(ratio.value - mean) / std::max(ratio.sigma, kMinSpread));
  }
  return std::max(kMadToSigma * medianInPlace(errors), kMinSpread);
}

/// Cauchy's loss of a ratio; claimed sigmas count only relative to each other.
struct RatioLoss {
  RatioLoss(const LogRatio& log_ratio, double mean, double spread) {
    const double sigma = spread * std::max(log_ratio.sigma, kMinSpread);
    const double error = (log_ratio.value - mean) / (kCauchyLimit * sigma);
    square = error * error;
    ratio = cauchyRatio(square, 1);
    weight = 1 / (sigma * sigma * ratio);
  }

  double square = 0;  ///< of the error over the loss's limit
  double ratio = 1;   ///< 1 + square
  double weight = 0;
};

/// Sandwich variance of an M-estimate, errors of a cell added up first.
/// @source Huber, Robust Statistics, section 6.3
double clusteredVariance(const std::vector<LogRatio>& ratios, double mean, double spread) {
  std::vector<double> of_cell(kErrorCells, 0.);
  double curvature = 0;
  for (const LogRatio& ratio : ratios) {
    const RatioLoss loss(ratio, mean, spread);
    of_cell[ratio.cell] += loss.weight * (ratio.value - mean);
    // Derivative of w(e) e: w (1 - e^2) / (1 + e^2), with the weight's own 1 / (1 + e^2).
    curvature += loss.weight * (1 - loss.square) / loss.ratio;
  }
  double scatter = 0;
  for (const double sum : of_cell) scatter += sum * sum;
  return scatter / (curvature * curvature);
}

/// Relative sigma of the length of a frame's translation, which is not 0.
double relativeSigmaOf(const PosedFrame& posed) {
  // exp(xi) T moves t by the translation of xi and turns it, which leaves its length.
  const Eigen::Vector3d t = posed.T_cam_ref->translation();
  const Eigen::Matrix3d covariance = posed.covariance->topLeftCorner<3, 3>();
  return std::sqrt(t.dot(covariance * t)) / t.squaredNorm();
}

/// Metres of a unit, from lengths and translations. The noise of the known ones is known, that of
/// the estimated ones is not: in the mean `square` has no noise, and `product` has none of either.
struct MetresFit {
  double product = 0;  // of known and estimated ones, weighted
  double square = 0;   // of known ones, weighted, less that of their noise

  void add(const DistancePrior& known, const Eigen::Vector3d& moved) {
    const double weight = 1 / (known.sigma * known.sigma);
    product += weight * known.metres * moved.norm();
    square += weight * known.metres * known.metres - 1;
  }
  void add(const PosePrior& known, const Eigen::Vector3d& moved) {
    const Eigen::Vector3d& t = known.T_frame_since.translation();
    Eigen::Matrix<double, 3, 6> J;  // of the translation of exp(xi) * T
    J << Eigen::Matrix3d::Identity(), -hat(t);
    const Eigen::Matrix3d covariance = J * known.covariance * J.transpose();
    const Eigen::Vector3d weighted = covariance.inverse() * t;
    product += weighted.dot(moved);
    square += weighted.dot(t) - 3;
  }
};

/// Translation of a posed frame since an earlier one.
std::optional<Eigen::Vector3d> motionSince(FrameId since,
                                           const PosedFrame& to,
                                           const InitializationResult& result) {
  for (const PosedFrame& from : result.frames) {
    if (from.frame->id() != since || !from.T_cam_ref || from.frame == to.frame) continue;
    return (*to.T_cam_ref * from.T_cam_ref->inverse()).translation();
  }
  return std::nullopt;
}

double shareWithin(const std::vector<LogRatio>& ratios, double mean, double limit) {
  const auto close = std::count_if(ratios.begin(), ratios.end(), [&](const LogRatio& ratio) {
    return std::abs(ratio.value - mean) < limit * std::max(ratio.sigma, kMinSpread);
  });
  return static_cast<double>(close) / static_cast<double>(ratios.size());
}

std::optional<MetricScale> scaleOf(const std::vector<LogRatio>& ratios) {
  if (ratios.size() < kMinDepths) return std::nullopt;
  std::vector<double> values;
  values.reserve(ratios.size());
  for (const LogRatio& ratio : ratios) values.push_back(ratio.value);
  double mean = medianOf(std::move(values));
  const double spread = spreadAround(mean, ratios);
  if (shareWithin(ratios, mean, kOutlier) < kMinAgreeing) return std::nullopt;
  for (int round = 0; round < kRounds; ++round) {
    double sum = 0;
    double total = 0;
    for (const LogRatio& ratio : ratios) {
      const double weight = RatioLoss(ratio, mean, spread).weight;
      sum += weight * ratio.value;
      total += weight;
    }
    mean = sum / total;
  }
  return MetricScale{std::exp(mean),
                     std::sqrt(clusteredVariance(ratios, mean, spread)),
                     static_cast<int>(ratios.size())};
}

}  // namespace

std::optional<MetricScale> scaleFromDepth(const InitializationResult& result,
                                          const KnownDepth& known) {
  check(result, known);
  return scaleOf(logRatios(result, known.depth, [&](int, int, double depth) {
    return std::hypot(known.sigma / depth, known.relative_sigma);
  }));
}

std::optional<MetricScale> scaleFromDepth(const InitializationResult& result,
                                          const DepthPrior& prior) {
  checkSize(prior);
  const ImageView depth(prior.depth.data(), prior.width, prior.height);
  check(result, {depth, 1, 0});
  const auto sigma = [&](int x, int y, double at) {
    const auto i = static_cast<std::size_t>(y) * static_cast<std::size_t>(prior.width) +
                   static_cast<std::size_t>(x);
    return static_cast<double>(prior.sigma[i]) / at;
  };
  const std::vector<LogRatio> ratios = logRatios(result, depth, sigma);
  std::optional<MetricScale> scale = scaleOf(ratios);
  if (!scale) return std::nullopt;
  double square = 0;
  std::set<std::size_t> cells;
  for (const LogRatio& ratio : ratios) {
    square += ratio.sigma * ratio.sigma;
    cells.insert(ratio.cell);
  }
  const auto samples = static_cast<double>(ratios.size() * cells.size());
  scale->relative_sigma = std::hypot(scale->relative_sigma, std::sqrt(square / samples));
  return scale;
}

std::optional<MetricScale> scaleFromDistance(const InitializationResult& result,
                                             const KnownDistance& known) {
  require(known.metres > 0 && std::isfinite(known.metres), "a distance above 0", known.metres);
  require(known.sigma > 0 && std::isfinite(known.sigma), "a sigma above 0", known.sigma);
  for (const PosedFrame& posed : result.frames) {
    if (posed.frame->id() != known.frame || !posed.T_cam_ref || !posed.covariance) continue;
    const double distance = posed.T_cam_ref->translation().norm();
    if (!(distance > 0)) return std::nullopt;
    return MetricScale{
        known.metres / distance, std::hypot(known.sigma / known.metres, relativeSigmaOf(posed)), 0};
  }
  return std::nullopt;
}

std::optional<MetricScale> scaleFromDistances(const InitializationResult& result) {
  MetresFit fit;
  for (const PosedFrame& to : result.frames) {
    const FramePriors* priors = to.frame->priors();
    if (priors == nullptr || !to.T_cam_ref) continue;
    if (const auto& known = priors->distance) {
      const auto moved = motionSince(known->since, to, result);
      if (moved) fit.add(*known, *moved);
    }
    if (const auto& known = priors->pose; known && known->has_translation) {
      const auto moved = motionSince(known->since, to, result);
      if (moved && result.report.pose_prior.value_or(true)) fit.add(*known, *moved);
    }
  }
  if (!(fit.product > 0) || !(fit.square > 0)) return std::nullopt;
  const PosedFrame& newest = result.frames.back();
  if (!newest.covariance) return std::nullopt;
  return MetricScale{
      fit.square / fit.product, std::hypot(1 / std::sqrt(fit.square), relativeSigmaOf(newest)), 0};
}

void toMetres(const MetricScale& scale, InitializationResult& result) {
  const double metres = scale.metres;  // `scale` may be the result's own
  require(metres > 0 && std::isfinite(metres), "a scale above 0", metres);
  for (InitPoint& point : result.points) changeUnit(metres, point.inverse_depth, point.variance);
  changeUnit(metres, result.frames);
  if (result.metric) result.metric->metres /= metres;
}

}  // namespace dsorb
