// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/bundle/map_assembly.h"

#include "init/orb/bundle/pose_from_points.h"

#include <cstddef>
#include <numeric>
#include <optional>

namespace dsorb::init_orb {
namespace {

/// Pose of a frame by constant motion between the nearest posed frames before and after it.
SE3 interpolatedPose(const InitialMap& map, int frame) {
  int before = frame;
  int after = frame;
  while (!map.frames[static_cast<std::size_t>(before)].T_cam_ref) --before;
  while (!map.frames[static_cast<std::size_t>(after)].T_cam_ref) ++after;
  const SE3& T_before = *map.frames[static_cast<std::size_t>(before)].T_cam_ref;
  const SE3& T_after = *map.frames[static_cast<std::size_t>(after)].T_cam_ref;
  const double share = static_cast<double>(frame - before) / static_cast<double>(after - before);
  return SE3::exp(share * (T_after * T_before.inverse()).log()) * T_before;
}

}  // namespace

std::vector<std::vector<PointSighting>> sightingsByFrame(const InitialMap& map,
                                                         const PinholeCamera& camera) {
  std::vector<std::vector<PointSighting>> sightings(map.frames.size());
  for (const Observation& observation : map.observations) {
    const Corner& corner = map.corners[static_cast<std::size_t>(observation.corner)];
    sightings[static_cast<std::size_t>(observation.frame)].push_back(
        {camera.unproject(corner.pixel), corner.inverse_depth, observation.pixel});
  }
  return sightings;
}

InitialMap makeInitialMap(const std::vector<FramePtr>& frames,
                          const CornerTracks& tracks,
                          const MotionHypothesis& motion) {
  InitialMap map;
  for (const FramePtr& frame : frames) map.frames.push_back({frame, {}, {}, {}});
  map.frames.front().T_cam_ref = SE3();
  map.frames.back().T_cam_ref = motion.T_target_ref;
  for (std::size_t track = 0; track < motion.points.size(); ++track) {
    const auto& point = motion.points[track];
    if (!point) continue;
    const int corner = static_cast<int>(map.corners.size());
    map.corners.push_back(
        {tracks.positions[0][track].cast<double>(), point->inverse_depth, point->variance});
    for (int frame = 1; frame < tracks.frames(); ++frame) {
      const Eigen::Vector2f& place = tracks.positions[static_cast<std::size_t>(frame)][track];
      if (place.allFinite()) map.observations.push_back({corner, frame, place.cast<double>()});
    }
  }
  return map;
}

void poseFramesBetween(InitialMap& map, const PinholeCamera& camera, double sigma) {
  const auto sightings = sightingsByFrame(map, camera);
  const Vector6d motion = map.frames.back().T_cam_ref->log();
  const auto last = static_cast<double>(map.frames.size() - 1);
  for (std::size_t frame = 1; frame + 1 < map.frames.size(); ++frame) {
    const SE3 guess = SE3::exp(static_cast<double>(frame) / last * motion);
    map.frames[frame].T_cam_ref =
        poseFromPoints(sightings[frame], camera, guess, sigma).value_or(guess);
  }
}

std::vector<int> poseFrames(InitialMap& map,
                            const PinholeCamera& camera,
                            const std::vector<int>& frames) {
  const auto sightings = sightingsByFrame(map, camera);
  std::vector<int> posed;
  for (const int frame : frames) {
    std::optional<SE3>& pose = map.frames[static_cast<std::size_t>(frame)].T_cam_ref;
    if (pose) continue;
    posed.push_back(frame);
    const SE3 guess = interpolatedPose(map, frame);
    const auto& seen = sightings[static_cast<std::size_t>(frame)];
    pose = poseFromPoints(seen, camera, guess, kTrackSigma).value_or(guess);
  }
  return posed;
}

std::vector<int> poseOtherFrames(InitialMap& map, const PinholeCamera& camera) {
  std::vector<int> frames(map.frames.size());
  std::iota(frames.begin(), frames.end(), 0);
  return poseFrames(map, camera, frames);
}

}  // namespace dsorb::init_orb
