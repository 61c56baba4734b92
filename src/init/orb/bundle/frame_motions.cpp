// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/bundle/frame_motions.h"

#include "estimate/variance_factors.h"
#include "geometry/recent_motion.h"
#include "init/orb/bundle/map_assembly.h"

#include <cstddef>

namespace dsorb::init_orb {
namespace {

std::vector<TimedPose> posesOf(InitialMap map, const PinholeCamera& camera) {
  poseOtherFrames(map, camera);
  std::vector<TimedPose> poses;
  for (const PosedFrame& frame : map.frames) {
    poses.push_back({frame.frame->timestamp(), *frame.T_cam_ref});
  }
  return poses;
}

bool isBetween(std::size_t k, std::size_t count) {
  return k > 0 && k + 1 < count;
}

std::vector<RowMotion> parabolasThrough(const std::vector<TimedPose>& poses) {
  std::vector<RowMotion> motions;
  const std::size_t count = poses.size();
  for (std::size_t k = 0; k < count; ++k) {
    std::vector<TimedPose> neighbours;
    if (k > 0) neighbours.push_back(poses[k - 1]);
    if (k + 1 < count) neighbours.push_back(poses[k + 1]);
    if (k + 2 < count) neighbours.push_back(poses[k + 2]);
    if (k > 1) neighbours.push_back(poses[k - 2]);
    motions.push_back(motionThrough(poses[k], neighbours));
  }
  return motions;
}

}  // namespace

std::vector<RowMotion> motionsByPoses(const InitialMap& map, const PinholeCamera& camera) {
  return parabolasThrough(posesOf(map, camera));
}

void estimateMotions(InitialMap& map, const PinholeCamera& camera) {
  if (!isRolling(*map.frames.front().frame)) return;
  if (map.motions.empty()) normalizeCornerScale(map);
  const std::vector<TimedPose> poses = posesOf(map, camera);
  const std::vector<RowMotion> means = parabolasThrough(poses);
  RecentMotion shown;
  for (const TimedPose& pose : poses) shown.push({pose});
  const Vector6d sigma = variance_factors::kRowMotion * shown.sigma();
  // A parabola that misses the velocity by jerk times squared interval over 3 misses the
  // acceleration by jerk times interval.
  const double interval =
      (poses.back().time - poses.front().time) / static_cast<double>(poses.size() - 1);
  const Vector6d acceleration_sigma = 3 / interval * sigma;
  if (map.motions.empty()) {
    for (const RowMotion& mean : means) map.motions.push_back({mean});
  }
  for (std::size_t k = 0; k < means.size(); ++k) {
    const double share = isBetween(k, means.size()) ? 0.5 : 1;
    map.motions[k].prior = {means[k], share * sigma, acceleration_sigma};
  }
  placeCorners(map, camera);
}

}  // namespace dsorb::init_orb
