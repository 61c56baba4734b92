// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/thesis/two_view.h"

#include "base/parallel.h"
#include "base/random.h"
#include "geometry/symmetric_eigen.h"
#include "init/orb/two_view/decomposition.h"

#include <Eigen/LU>
#include <Eigen/QR>
#include <Eigen/SVD>

#include <cassert>
#include <cmath>
#include <numeric>
#include <utility>

namespace dsorb::init_orb {
namespace {

constexpr int kRounds = 200;                     // of RANSAC; both models use the same samples
constexpr double kHomographyThreshold = kGamma;  // T_H
constexpr double kFundamentalThreshold = 3.84;   // T_F: chi-square, 1 degree of freedom, 95 %
constexpr int kMaxRefits = 5;
constexpr double kMinPivot = 1e-9;  // of a normalised 8x9 system; less: the sample is degenerate

using System = Eigen::Matrix<double, 8, 9>;

Eigen::Matrix3d asMatrix(const Eigen::Matrix<double, 9, 1>& rows) {
  return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(rows.data());
}

/// Null vector of an 8x9 system as a row-major 3x3 matrix; nullopt when the rank is below 8.
std::optional<Eigen::Matrix3d> nullMatrix(const System& system) {
  const Eigen::ColPivHouseholderQR<Eigen::Matrix<double, 9, 8>> qr(system.transpose());
  if (!(std::abs(qr.matrixR()(7, 7)) > kMinPivot)) return std::nullopt;
  // The last column of Q, by single reflections: the product of Eigen takes long to compile.
  const auto reflections = qr.householderQ();
  Eigen::Matrix<double, 9, 1> null = Eigen::Matrix<double, 9, 1>::Unit(8);
  double workspace = 0;
  for (Eigen::Index k = 7; k >= 0; --k) {
    null.tail(9 - k).applyHouseholderOnTheLeft(
        reflections.essentialVector(k), qr.hCoeffs()[k], &workspace);
  }
  return asMatrix(null);
}

double signedArea(const Eigen::Vector2d& a, const Eigen::Vector2d& b, const Eigen::Vector2d& c) {
  return (b - a).x() * (c - a).y() - (b - a).y() * (c - a).x();
}

/// A plane in front of both cameras keeps the orientation of triangles, all of them or none.
bool keepsOrientation(const Matches& matches, const Sample& sample) {
  int kept = 0;
  for (std::size_t leave_out = 0; leave_out < 4; ++leave_out) {
    const std::uint32_t a = sample[(leave_out + 1) % 4];
    const std::uint32_t b = sample[(leave_out + 2) % 4];
    const std::uint32_t c = sample[(leave_out + 3) % 4];
    const double before =
        signedArea(matches.reference[a], matches.reference[b], matches.reference[c]);
    const double after = signedArea(matches.target[a], matches.target[b], matches.target[c]);
    if (before * after > 0) ++kept;
  }
  return kept == 4;
}

/// The linear equations of one match: two rows for a homography, one (and one of zeros) for a
/// fundamental matrix.
using Rows = Eigen::Matrix<double, 2, 9>;

Rows equations(TwoViewModel kind, const Eigen::Vector2d& r, const Eigen::Vector2d& t) {
  Rows rows = Rows::Zero();
  if (kind == TwoViewModel::kHomography) {
    rows.row(0) << 0, 0, 0, -r.x(), -r.y(), -1, t.y() * r.x(), t.y() * r.y(), t.y();
    rows.row(1) << r.x(), r.y(), 1, 0, 0, 0, -t.x() * r.x(), -t.x() * r.y(), -t.x();
  } else {
    rows.row(0) << t.x() * r.x(), t.x() * r.y(), t.x(), t.y() * r.x(), t.y() * r.y(), t.y(), r.x(),
        r.y(), 1;
  }
  return rows;
}

Eigen::Matrix3d withRankTwo(const Eigen::Matrix3d& full) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(full, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Vector3d singular_values = svd.singularValues();
  singular_values[2] = 0;
  return svd.matrixU() * singular_values.asDiagonal() * svd.matrixV().transpose();
}

/// Shift to the centroid and scale to a mean distance of sqrt(2).
/// @source Hartley, In Defense of the Eight-Point Algorithm, PAMI 1997
Eigen::Matrix3d normalize(std::vector<Eigen::Vector2d>& points) {
  const auto n = static_cast<double>(points.size());
  const Eigen::Vector2d centroid =
      std::accumulate(points.begin(), points.end(), Eigen::Vector2d(0, 0)) / n;
  double distance = 0;
  for (const Eigen::Vector2d& point : points) distance += (point - centroid).norm() / n;
  const double scale = distance > 0 ? std::sqrt(2.0) / distance : 1.0;
  for (Eigen::Vector2d& point : points) point = scale * (point - centroid);
  Eigen::Matrix3d T;
  T << scale, 0, -scale * centroid.x(), 0, scale, -scale * centroid.y(), 0, 0, 1;
  return T;
}

std::vector<Sample> drawSamples(std::size_t n, int rounds, std::uint64_t seed) {
  Random random(seed);
  std::vector<std::uint32_t> order(n);
  std::iota(order.begin(), order.end(), 0U);
  std::vector<Sample> samples(static_cast<std::size_t>(rounds));
  for (Sample& sample : samples) {
    for (std::uint32_t i = 0; i < sample.size(); ++i) {
      std::swap(order[i], order[i + random.below(static_cast<std::uint32_t>(n) - i)]);
      sample[i] = order[i];
    }
  }
  return samples;
}

/// Least squares over all inliers instead of through one sample.
Eigen::Matrix3d solveOverInliers(TwoViewModel kind,
                                 const Matches& matches,
                                 const std::vector<char>& inlier) {
  Eigen::Matrix<double, 9, 9> normal = Eigen::Matrix<double, 9, 9>::Zero();
  for (std::size_t i = 0; i < matches.size(); ++i) {
    if (inlier[i] == 0) continue;
    const Rows rows = equations(kind, matches.reference[i], matches.target[i]);
    normal += rows.transpose() * rows;
  }
  const Eigen::Matrix3d matrix = asMatrix(symmetricEigen(normal).vectors.col(0));
  return kind == TwoViewModel::kHomography ? matrix : withRankTwo(matrix);
}

/// Calls visit(index, {distance in the target, distance in the reference}), both squared, as long
/// as it returns true.
template <typename Visit>
void forDistances(TwoViewModel kind,
                  const Eigen::Matrix3d& matrix,
                  const Matches& matches,
                  Visit&& visit) {
  if (kind == TwoViewModel::kHomography) {
    const Eigen::Matrix3d inverse = matrix.inverse();
    for (std::size_t i = 0; i < matches.size(); ++i) {
      const auto distances =
          homographyDistances(matrix, inverse, matches.reference[i], matches.target[i]);
      if (!visit(i, distances)) return;
    }
    return;
  }
  for (std::size_t i = 0; i < matches.size(); ++i) {
    if (!visit(i, fundamentalDistances(matrix, matches.reference[i], matches.target[i]))) return;
  }
}

constexpr std::size_t kScoreBlock = 32;  // matches scored between two looks at the bound

double thresholdOf(TwoViewModel kind) {
  return kind == TwoViewModel::kHomography ? kHomographyThreshold : kFundamentalThreshold;
}

/// @param needed the rest of a model that cannot reach this score is not counted
double scoreOnly(TwoViewModel kind,
                 const Eigen::Matrix3d& matrix,
                 const Matches& matches,
                 double information,
                 double needed = 0) {
  const double threshold = thresholdOf(kind);
  double score = 0;
  forDistances(kind, matrix, matches, [&](std::size_t i, const std::array<double, 2>& distances) {
    score += supportOf(distances[0] * information, threshold) +
             supportOf(distances[1] * information, threshold);
    const auto left = static_cast<double>(matches.size() - i - 1);
    return (i + 1) % kScoreBlock != 0 || score + 2 * kGamma * left > needed;
  });
  return score;
}

struct Normalized {
  Matches matches;
  Eigen::Matrix3d T_reference;
  Eigen::Matrix3d T_target;

  [[nodiscard]] Eigen::Matrix3d toPixels(TwoViewModel kind, const Eigen::Matrix3d& matrix) const {
    return kind == TwoViewModel::kHomography
               ? Eigen::Matrix3d(T_target.inverse() * matrix * T_reference)
               : Eigen::Matrix3d(T_target.transpose() * matrix * T_reference);
  }
};

/// Fits the model to its inliers, as long as its score rises.
ScoredModel refit(ScoredModel model,
                  TwoViewModel kind,
                  const Matches& matches,
                  const Normalized& normalized,
                  double sigma) {
  for (int round = 0; round < kMaxRefits; ++round) {
    if (model.inliers < static_cast<int>(std::tuple_size<Sample>::value)) break;
    const Eigen::Matrix3d solution = solveOverInliers(kind, normalized.matches, model.inlier);
    ScoredModel refitted = scoreModel(kind, normalized.toPixels(kind, solution), matches, sigma);
    if (!(refitted.score > model.score)) break;
    model = std::move(refitted);
  }
  return model;
}

ScoredModel fitModel(TwoViewModel kind,
                     const Matches& matches,
                     const Normalized& normalized,
                     const std::vector<Sample>& samples,
                     double sigma) {
  const double information = 1.0 / (sigma * sigma);
  double best_score = 0;
  Eigen::Matrix3d best = Eigen::Matrix3d::Zero();
  for (const Sample& sample : samples) {
    const auto solution = solveModel(kind, normalized.matches, sample);
    if (!solution) continue;
    const Eigen::Matrix3d matrix = normalized.toPixels(kind, *solution);
    const double score = scoreOnly(kind, matrix, matches, information, best_score);
    if (score > best_score) {
      best_score = score;
      best = matrix;
    }
  }
  if (best_score > 0) {
    return refit(scoreModel(kind, best, matches, sigma), kind, matches, normalized, sigma);
  }
  ScoredModel none;
  none.inlier.assign(matches.size(), 0);
  return none;
}

}  // namespace

ScoredModel scoreModel(TwoViewModel kind,
                       const Eigen::Matrix3d& matrix,
                       const Matches& matches,
                       double sigma) {
  const double information = 1.0 / (sigma * sigma);
  const double threshold = thresholdOf(kind);
  ScoredModel model;
  model.matrix = matrix;
  model.score = scoreOnly(kind, matrix, matches, information);
  model.inlier.assign(matches.size(), 0);
  forDistances(kind, matrix, matches, [&](std::size_t i, const std::array<double, 2>& distances) {
    const bool fits =
        distances[0] * information < threshold && distances[1] * information < threshold;
    model.inlier[i] = fits ? 1 : 0;
    model.inliers += fits ? 1 : 0;
    return true;
  });
  return model;
}

std::optional<Eigen::Matrix3d> solveModel(TwoViewModel kind,
                                          const Matches& matches,
                                          const Sample& sample) {
  System system;
  if (kind == TwoViewModel::kHomography) {
    if (!keepsOrientation(matches, sample)) return std::nullopt;
    for (std::size_t i = 0; i < 4; ++i) {
      system.middleRows<2>(Eigen::Index{2} * static_cast<Eigen::Index>(i)) =
          equations(kind, matches.reference[sample[i]], matches.target[sample[i]]);
    }
    return nullMatrix(system);
  }
  for (std::size_t i = 0; i < 8; ++i) {
    system.row(static_cast<int>(i)) =
        equations(kind, matches.reference[sample[i]], matches.target[sample[i]]).row(0);
  }
  const std::optional<Eigen::Matrix3d> full = nullMatrix(system);
  if (!full) return std::nullopt;
  return withRankTwo(*full);
}

ModelPair fitModels(const Matches& matches, std::uint64_t seed) {
  assert(matches.size() >= std::tuple_size<Sample>::value);
  Normalized normalized{matches, {}, {}};
  normalized.T_reference = normalize(normalized.matches.reference);
  normalized.T_target = normalize(normalized.matches.target);
  const std::vector<Sample> samples = drawSamples(matches.size(), kRounds, seed);
  const auto fit = [&](TwoViewModel kind) {
    return fitModel(kind, matches, normalized, samples, kCornerSigma);
  };
  ModelPair pair;
  runBoth([&] { pair.homography = fit(TwoViewModel::kHomography); },
          [&] { pair.fundamental = fit(TwoViewModel::kFundamental); });
  return pair;
}

}  // namespace dsorb::init_orb
