// SPDX-License-Identifier: BSD-3-Clause
#include "features/pose_from_matches.h"

#include "base/median.h"
#include "estimate/warp.h"
#include "features/ransac.h"
#include "image/cell_grid.h"
#include "image/image_scale.h"

#include <opencv2/calib3d.hpp>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

namespace dsorb {
namespace {

constexpr float kMaxDistanceOfDepth = 8;  // of a feature's to its sample, for 800 px [px]
constexpr double kPoseThreshold = 4;      // of an inlier, for a diagonal of 800 px [px]
constexpr int kMaxPoseRounds = 500;       // of RANSAC; it stops when it is sure
constexpr int kPoseRefits = 3;            // of pose and inliers

double thresholdFor(const PinholeCamera& camera) {
  return kPoseThreshold * std::max(0.5, imageScale(camera.width, camera.height));
}

std::optional<SE3> sampledPose(const std::vector<PointObservation>& matches,
                               const PinholeCamera& camera,
                               std::uint64_t seed) {
  std::vector<cv::Point3d> points;
  std::vector<cv::Point2d> pixels;
  for (const PointObservation& match : matches) {
    const Eigen::Vector3d point = match.host_ray / match.inverse_depth;
    points.emplace_back(point.x(), point.y(), point.z());
    pixels.emplace_back(match.pixel.x(), match.pixel.y());
  }
  cv::Mat K(toCv(camera.matrix()));
  cv::Vec3d rotation;
  cv::Vec3d translation;
  std::vector<int> inliers;
  const bool found =
      cv::solvePnPRansac(points,
                         pixels,
                         K,
                         cv::Mat::zeros(1, 4, CV_64F),
                         rotation,
                         translation,
                         inliers,
                         ransacParameters(thresholdFor(camera), kMaxPoseRounds, seed));
  if (!found) return std::nullopt;
  const SE3 pose(so3Exp({rotation[0], rotation[1], rotation[2]}),
                 Eigen::Vector3d(translation[0], translation[1], translation[2]));
  return pose.log().allFinite() ? std::optional(pose) : std::nullopt;
}

/// Distances between where matches are and where a pose shows the points; infinite behind it [px].
std::vector<double> errorsOf(const std::vector<PointObservation>& matches,
                             const PinholeCamera& camera,
                             const SE3& T_cam_host) {
  std::vector<double> errors;
  for (const PointObservation& match : matches) {
    const auto seen = projectHosted(camera, T_cam_host, match.host_ray, match.inverse_depth);
    errors.push_back(seen ? (seen->pixel - match.pixel).norm() : INFINITY);
  }
  return errors;
}

std::vector<PointObservation> marked(const std::vector<PointObservation>& matches,
                                     const std::vector<char>& inlier) {
  std::vector<PointObservation> kept;
  for (std::size_t i = 0; i < matches.size(); ++i) {
    if (inlier[i] != 0) kept.push_back(matches[i]);
  }
  return kept;
}

}  // namespace

DescribedPoints describePoints(const DescribedFrame& frame,
                               const std::vector<DepthSample>& depths) {
  const Frame& image = *frame.frame;
  const auto max_distance =
      kMaxDistanceOfDepth * static_cast<float>(imageScale(image.width(), image.height()));
  std::vector<Eigen::Vector2f> pixels;
  for (const DepthSample& sample : depths) pixels.push_back(sample.pixel);
  const PointGrid grid(std::move(pixels), CellGrid(image.width(), image.height(), max_distance));
  const auto in_front = [&](std::size_t i) { return depths[i].inverse_depth > 0; };
  DescribedPoints points;
  points.corners.gain = frame.gain;
  for (std::size_t i = 0; i < frame.positions.size(); ++i) {
    const auto sample = grid.nearest<1>(frame.positions[i], max_distance, in_front);
    if (sample.count == 0) continue;
    points.corners.features.points.push_back(frame.features.points[i]);
    points.corners.features.descriptors.push_back(
        frame.features.descriptors.row(static_cast<int>(i)));
    points.corners.positions.push_back(frame.positions[i]);
    points.inverse_depths.push_back(depths[sample.nearest[0].point].inverse_depth);
  }
  return points;
}

std::vector<PointObservation> matchPoints(const DescribedPoints& points,
                                          const DescribedFrame& frame,
                                          const PinholeCamera& camera) {
  std::vector<PointObservation> matches;
  if (points.inverse_depths.empty() || frame.positions.empty()) return matches;
  const std::vector<int> partner = findPartners(points.corners, frame);
  for (std::size_t i = 0; i < partner.size(); ++i) {
    if (partner[i] < 0) continue;
    const Eigen::Vector2f& place = frame.positions[static_cast<std::size_t>(partner[i])];
    matches.push_back({camera.unproject(points.corners.positions[i].cast<double>()),
                       static_cast<double>(points.inverse_depths[i]),
                       place.cast<double>()});
  }
  return matches;
}

int countAgreeing(const std::vector<PointObservation>& matches,
                  const PinholeCamera& camera,
                  const SE3& T_cam_host) {
  const std::vector<double> errors = errorsOf(matches, camera, T_cam_host);
  const double threshold = thresholdFor(camera);
  return static_cast<int>(
      std::count_if(errors.begin(), errors.end(), [&](double error) { return error < threshold; }));
}

std::optional<MatchedPose> poseFromMatches(const std::vector<PointObservation>& matches,
                                           const PinholeCamera& camera,
                                           std::uint64_t seed) {
  if (matches.size() < kMinPoseInliers) return std::nullopt;
  const std::optional<SE3> sampled = sampledPose(matches, camera, seed);
  if (!sampled) return std::nullopt;
  const double threshold = thresholdFor(camera);
  const double sigma = threshold / huberLimit(1);
  MatchedPose pose;
  pose.T_cam_host = *sampled;
  std::vector<PointObservation> kept;
  for (int refit = 0;; ++refit) {
    std::vector<double> errors = errorsOf(matches, camera, pose.T_cam_host);
    pose.inlier.clear();
    for (const double error : errors) pose.inlier.push_back(error < threshold ? 1 : 0);
    kept = marked(matches, pose.inlier);
    pose.inliers = static_cast<int>(kept.size());
    if (pose.inliers < kMinPoseInliers) return std::nullopt;
    const auto middle = errors.begin() + pose.inliers / 2;
    std::nth_element(errors.begin(), middle, errors.end());
    pose.noise = *middle / kMedianLength;
    if (refit == kPoseRefits) break;
    const std::optional<SE3> refined = poseFromPoints(kept, camera, pose.T_cam_host, sigma);
    if (!refined) return std::nullopt;
    pose.T_cam_host = *refined;
  }
  const auto covariance = poseCovariance(kept, camera, pose.T_cam_host, {sigma, 1});
  if (!covariance) return std::nullopt;
  pose.covariance = *covariance;
  return pose;
}

}  // namespace dsorb
