// SPDX-License-Identifier: BSD-3-Clause
#include "published/two_view.h"

#include "base/angles.h"
#include "base/parallel.h"
#include "base/random.h"
#include "estimate/pose_from_points.h"
#include "estimate/warp.h"
#include "geometry/symmetric_eigen.h"
#include "geometry/triangulate.h"
#include "two_view/essential_motion.h"

#include <Eigen/QR>
#include <Eigen/SVD>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <utility>

namespace dsorb::published {
namespace {

constexpr double kSigma = 1;  // of a corner's position, each axis [px]
constexpr int kRounds = 200;  // of RANSAC; both models use the same samples
constexpr int kMaxRefits = 5;
constexpr double kMinPivot = 1e-9;  // of a normalised 8x9 system; less: the sample is degenerate

// Gates of the thesis.
constexpr double kHomographyShare = 0.4;  // homography above it; [Gladkova], eq. (1)
constexpr int kMinTriangulated = 50;      // good points of the best motion
constexpr double kMinGoodShare = 0.9;     // good points of the best motion, of the inliers
constexpr double kMaxSecondShare = 0.7;   // good points of the second motion, of the best's
constexpr double kMinParallaxDeg = 1;     // of the point of kParallaxRank
constexpr int kParallaxRank = 51;
constexpr double kMaxSquaredError = 4;  // of a good point, ORB-SLAM's limit [sigma^2]

/// T_M: chi-square of 2 and of 1 degree of freedom, 95 %.
double thresholdOf(Model model) {
  return model == Model::kHomography ? 5.99 : 3.84;
}

using System = Eigen::Matrix<double, 8, 9>;
using Rows = Eigen::Matrix<double, 2, 9>;

Eigen::Matrix3d asMatrix(const Eigen::Matrix<double, 9, 1>& rows) {
  return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(rows.data());
}

/// Null vector of an 8x9 system as a row-major 3x3 matrix; nullopt when the rank is below 8.
std::optional<Eigen::Matrix3d> nullMatrix(const System& system) {
  const Eigen::ColPivHouseholderQR<Eigen::Matrix<double, 9, 8>> qr(system.transpose());
  if (!(std::abs(qr.matrixR()(7, 7)) > kMinPivot)) return std::nullopt;
  const Eigen::Matrix<double, 9, 1> last = Eigen::Matrix<double, 9, 1>::Unit(8);
  return asMatrix(qr.householderQ() * last);
}

/// A plane in front of both cameras keeps the orientation of triangles, all of them or none.
bool keepsOrientation(const Matches& matches, const SampleIndices& sample) {
  for (std::size_t leave_out = 0; leave_out < 4; ++leave_out) {
    const auto area = [&](const std::vector<Eigen::Vector2d>& points) {
      const Eigen::Vector2d& a = points[sample[(leave_out + 1) % 4]];
      const Eigen::Vector2d b = points[sample[(leave_out + 2) % 4]] - a;
      const Eigen::Vector2d c = points[sample[(leave_out + 3) % 4]] - a;
      return b.x() * c.y() - b.y() * c.x();
    };
    if (!(area(matches.reference) * area(matches.target) > 0)) return false;
  }
  return true;
}

/// The linear equations of one match: two rows for a homography, one (and one of zeros) for a
/// fundamental matrix.
Rows equations(Model model, const Eigen::Vector2d& r, const Eigen::Vector2d& t) {
  Rows rows = Rows::Zero();
  if (model == Model::kHomography) {
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

std::vector<SampleIndices> drawSamples(std::size_t n, std::uint64_t seed) {
  Random random(seed);
  std::vector<std::uint32_t> order(n);
  std::iota(order.begin(), order.end(), 0U);
  std::vector<SampleIndices> samples(kRounds);
  for (SampleIndices& sample : samples) {
    for (std::uint32_t i = 0; i < sample.size(); ++i) {
      std::swap(order[i], order[i + random.below(static_cast<std::uint32_t>(n) - i)]);
      sample[i] = order[i];
    }
  }
  return samples;
}

/// Least squares over all inliers instead of through one sample.
Eigen::Matrix3d solveOverInliers(Model model, const Matches& matches, const ScoredModel& scored) {
  Eigen::Matrix<double, 9, 9> normal = Eigen::Matrix<double, 9, 9>::Zero();
  for (std::size_t i = 0; i < matches.size(); ++i) {
    if (scored.inlier[i] == 0) continue;
    const Rows rows = equations(model, matches.reference[i], matches.target[i]);
    normal += rows.transpose() * rows;
  }
  const Eigen::Matrix3d matrix = asMatrix(symmetricEigen(normal).vectors.col(0));
  return model == Model::kHomography ? matrix : withRankTwo(matrix);
}

/// RANSAC, then fits to the inliers as long as the score rises.
ScoredModel fitModel(Model model, const Matches& matches, std::uint64_t seed) {
  Matches normalized = matches;
  const Eigen::Matrix3d T_reference = normalize(normalized.reference);
  const Eigen::Matrix3d T_target = normalize(normalized.target);
  const Eigen::Matrix3d back =
      model == Model::kHomography ? Eigen::Matrix3d(T_target.inverse()) : T_target.transpose();
  ScoredModel best;
  best.inlier.assign(matches.size(), 0);
  const auto improves = [&](const Eigen::Matrix3d& solution) {
    ScoredModel scored = scoreModel(model, back * solution * T_reference, matches);
    const bool better = scored.score > best.score;
    if (better) best = std::move(scored);
    return better;
  };
  for (const SampleIndices& sample : drawSamples(matches.size(), seed)) {
    if (const auto solution = solveModel(model, normalized, sample)) improves(*solution);
  }
  for (int refits = 0; refits < kMaxRefits && best.inliers >= 8; ++refits) {
    if (!improves(solveOverInliers(model, normalized, best))) break;
  }
  return best;
}

/// Triangulates matches under a motion and keeps the good ones: in front of both cameras and within
/// two sigma of the measured position. (The position in the reference is exact: there the point is
/// hosted.)
Hypothesis evaluateMotion(const SE3& T_cur_ref,
                          const Matches& matches,
                          const std::vector<char>& inlier,
                          const PinholeCamera& camera) {
  Hypothesis hypothesis;
  hypothesis.T_cur_ref = T_cur_ref;
  std::vector<double> parallaxes;
  for (std::size_t i = 0; i < matches.size(); ++i) {
    hypothesis.points.emplace_back();
    const Eigen::Vector3d ray = camera.unproject(matches.reference[i]);
    const Eigen::Vector3d target_ray = camera.unproject(matches.target[i]);
    const auto point =
        triangulateInverseDepth(T_cur_ref, ray, target_ray.head<2>(), kSigma / camera.fx);
    if (!point || !(point->inverse_depth > 0)) continue;
    const auto seen = projectHosted(camera, T_cur_ref, ray, point->inverse_depth);
    if (!seen || (seen->pixel - matches.target[i]).squaredNorm() > kMaxSquaredError) continue;
    hypothesis.points[i] = {
        matches.reference[i].cast<float>(), point->inverse_depth, point->variance, 0};
    if (inlier[i] == 0) continue;
    ++hypothesis.good;
    parallaxes.push_back(parallaxAngle(T_cur_ref, ray, target_ray) * kDegPerRad);
  }
  if (parallaxes.empty()) return hypothesis;
  const auto rank = std::min<std::ptrdiff_t>(kParallaxRank, hypothesis.good) - 1;
  std::nth_element(
      parallaxes.begin(), parallaxes.begin() + rank, parallaxes.end(), std::greater<>());
  hypothesis.parallax_deg = parallaxes[static_cast<std::size_t>(rank)];
  return hypothesis;
}

/// cv::decomposeHomographyMat, or cv::decomposeEssentialMat of E = K^T F K.
std::vector<SE3> decompose(Model model,
                           const Eigen::Matrix3d& matrix,
                           const PinholeCamera& camera) {
  const Eigen::Matrix3d K = camera.matrix();
  return model == Model::kHomography ? decomposeHomography(matrix, camera)
                                     : decomposeEssential(K.transpose() * matrix * K);
}

InitReason judge(const RelativeMotion& motion) {
  const int good = motion.best.good;
  if (motion.inliers < kMinTriangulated) return InitReason::kTooFewPoints;
  const double needed = std::max<double>(kMinGoodShare * motion.inliers, kMinTriangulated);
  if (good < needed) return InitReason::kPoorQuality;
  if (motion.second_good > kMaxSecondShare * good) return InitReason::kDegenerateMotion;
  if (motion.best.parallax_deg < kMinParallaxDeg) return InitReason::kTooLittleParallax;
  return InitReason::kDone;
}

}  // namespace

std::array<double, 2> transferDistances(Model model,
                                        const Eigen::Matrix3d& matrix,
                                        const Eigen::Matrix3d& back,
                                        const Eigen::Vector2d& reference,
                                        const Eigen::Vector2d& target) {
  const Eigen::Vector3d forward = matrix * reference.homogeneous();
  const Eigen::Vector3d backward = back * target.homogeneous();
  if (model == Model::kHomography) {
    return {(forward.head<2>() / forward.z() - target).squaredNorm(),
            (backward.head<2>() / backward.z() - reference).squaredNorm()};
  }
  const double residual = target.homogeneous().dot(forward);
  return {residual * residual / forward.head<2>().squaredNorm(),
          residual * residual / backward.head<2>().squaredNorm()};
}

ScoredModel scoreModel(Model model, const Eigen::Matrix3d& matrix, const Matches& matches) {
  ScoredModel scored{matrix, 0, {}, 0};
  const Eigen::Matrix3d back =
      model == Model::kHomography ? Eigen::Matrix3d(matrix.inverse()) : matrix.transpose();
  const double threshold = thresholdOf(model);
  for (std::size_t i = 0; i < matches.size(); ++i) {
    const auto [d_cr, d_rc] =
        transferDistances(model, matrix, back, matches.reference[i], matches.target[i]);
    scored.score += supportOf(d_cr, threshold) + supportOf(d_rc, threshold);
    const bool fits = d_cr < threshold && d_rc < threshold;
    scored.inlier.push_back(fits ? 1 : 0);
    scored.inliers += fits ? 1 : 0;
  }
  return scored;
}

std::optional<Eigen::Matrix3d> solveModel(Model model,
                                          const Matches& matches,
                                          const SampleIndices& sample) {
  const bool homography = model == Model::kHomography;
  if (homography && !keepsOrientation(matches, sample)) return std::nullopt;
  const Eigen::Index rows = homography ? 2 : 1;  // of a match
  System system;
  for (Eigen::Index i = 0; i < 8 / rows; ++i) {
    const std::uint32_t match = sample[static_cast<std::size_t>(i)];
    system.middleRows(rows * i, rows) =
        equations(model, matches.reference[match], matches.target[match]).topRows(rows);
  }
  const std::optional<Eigen::Matrix3d> full = nullMatrix(system);
  return full && !homography ? std::optional(withRankTwo(*full)) : full;
}

ModelPair fitModels(const Matches& matches, std::uint64_t seed) {
  ModelPair pair;
  runBoth([&] { pair.homography = fitModel(Model::kHomography, matches, seed); },
          [&] { pair.fundamental = fitModel(Model::kFundamental, matches, seed); });
  return pair;
}

RelativeMotion estimateMotion(const Matches& matches,
                              const PinholeCamera& camera,
                              ModelChoice choice,
                              std::uint64_t seed) {
  const ModelPair pair = fitModels(matches, seed);
  RelativeMotion motion;
  const bool planar = choice == ModelChoice::kScore
                          ? pair.homographyShare() > kHomographyShare
                          : pair.homography.inliers >= pair.fundamental.inliers;
  motion.model = planar ? Model::kHomography : Model::kFundamental;
  const ScoredModel& chosen = planar ? pair.homography : pair.fundamental;
  motion.inliers = chosen.inliers;
  motion.reason = InitReason::kTooFewPoints;
  if (chosen.inliers == 0) return motion;
  for (const SE3& decomposed : decompose(motion.model, chosen.matrix, camera)) {
    const SE3 refined = refineMotion(decomposed, matches, chosen.inlier, camera, kSigma);
    Hypothesis hypothesis = evaluateMotion(refined, matches, chosen.inlier, camera);
    if (hypothesis.good > motion.best.good) std::swap(hypothesis, motion.best);
    motion.second_good = std::max(motion.second_good, hypothesis.good);
  }
  motion.reason = judge(motion);
  return motion;
}

Map makeMap(const std::vector<FramePtr>& frames,
            const CornerTracks& tracks,
            const Hypothesis& motion,
            const PinholeCamera& camera) {
  Map map;
  for (const FramePtr& frame : frames) map.frames.push_back({frame, {}, {}, {}});
  std::vector<std::vector<PointObservation>> by_frame(frames.size());
  for (std::size_t track = 0; track < motion.points.size(); ++track) {
    if (!motion.points[track]) continue;
    const std::size_t corner = map.points.size();
    map.points.push_back(*motion.points[track]);
    for (std::size_t frame = 1; frame < frames.size(); ++frame) {
      const Eigen::Vector2f& place = tracks.positions[frame][track];
      if (!place.allFinite()) continue;
      map.observations.push_back({corner, frame, place.cast<double>()});
      by_frame[frame].push_back({camera.unproject(map.points[corner].pixel.cast<double>()),
                                 map.points[corner].inverse_depth,
                                 place.cast<double>()});
    }
  }
  map.corners = map.points.size();
  map.frames.front().T_cam_ref = SE3();
  map.frames.back().T_cam_ref = motion.T_cur_ref;
  const Vector6d twist = motion.T_cur_ref.log();
  const auto last = static_cast<double>(frames.size() - 1);
  for (std::size_t frame = 1; frame + 1 < frames.size(); ++frame) {
    const SE3 guess = SE3::exp(static_cast<double>(frame) / last * twist);
    map.frames[frame].T_cam_ref =
        poseFromPoints(by_frame[frame], camera, guess, kSigma).value_or(guess);
  }
  return map;
}

}  // namespace dsorb::published
