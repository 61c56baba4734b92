// SPDX-License-Identifier: BSD-3-Clause
#include "odometry/matched_poses.h"

#include "features/grey_image.h"

#include <cstddef>
#include <utility>

namespace dsorb::odometry {
namespace {

std::vector<DepthSample> samplesOf(const track::TrackingReference& reference) {
  const track::ReferencePoints& points = reference.at(0);
  std::vector<DepthSample> samples;
  samples.reserve(points.size());
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Eigen::Vector2d pixel = reference.camera.project({points.ray_x[i], points.ray_y[i], 1});
    samples.push_back({pixel.cast<float>(), points.inverse_depth[i]});
  }
  return samples;
}

}  // namespace

std::optional<MatchEvidence> MatchedPoses::find(const FramePtr& frame,
                                                const track::TrackingReference& reference) {
  if (host_frame_ != reference.frame) {
    host_frame_ = reference.frame;
    mean_ = meanIntensity(*host_frame_);
    const bool described = frame_ == host_frame_ && described_.gain == 1;
    points_ = describePoints(described ? described_ : describeFrame(host_frame_, 1),
                             samplesOf(reference));
  }
  if (frame_ != frame) {
    frame_ = frame;
    described_ = describeFrame(frame, gainTowards(mean_, *frame));
  }
  MatchEvidence evidence;
  evidence.matches = matchPoints(points_, described_, reference.camera);
  std::optional<MatchedPose> pose = poseFromMatches(evidence.matches, reference.camera, seed_);
  if (!pose) return std::nullopt;
  evidence.pose = std::move(*pose);
  return evidence;
}

}  // namespace dsorb::odometry
