// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/bundle/map_assembly.h"

#include "estimate/variance_factors.h"
#include "geometry/recent_motion.h"

#include <algorithm>
#include <cstddef>
#include <numeric>
#include <optional>

namespace dsorb::init_orb {
namespace {

/// Pose of a frame by constant motion between the nearest posed frames before and after it.
SE3 interpolatedPose(const InitialMap& map, std::size_t frame) {
  std::size_t before = frame;
  std::size_t after = frame;
  while (!map.frames[before].T_cam_ref) --before;
  while (!map.frames[after].T_cam_ref) ++after;
  const SE3& T_before = *map.frames[before].T_cam_ref;
  const SE3& T_after = *map.frames[after].T_cam_ref;
  const double share = static_cast<double>(frame - before) / static_cast<double>(after - before);
  return SE3::exp(share * (T_after * T_before.inverse()).log()) * T_before;
}

std::vector<TimedPose> posesOf(InitialMap map, const PinholeCamera& camera) {
  poseOtherFrames(map, camera);
  std::vector<TimedPose> poses;
  for (const PosedFrame& frame : map.frames) {
    poses.push_back({frame.frame->timestamp(), *frame.T_cam_ref});
  }
  return poses;
}

}  // namespace

std::vector<std::vector<PointObservation>> observationsByFrame(const InitialMap& map,
                                                               const PinholeCamera& camera) {
  std::vector<std::vector<PointObservation>> observations(map.frames.size());
  for (const CornerObservation& observation : map.observations) {
    const Corner& corner = map.corners[observation.corner];
    observations[observation.frame].push_back(
        {camera.unproject(corner.pixel), corner.inverse_depth, observation.pixel});
  }
  return observations;
}

InitialMap makeInitialMap(const std::vector<FramePtr>& frames,
                          const CornerTracks& tracks,
                          const MotionHypothesis& motion) {
  InitialMap map;
  for (const FramePtr& frame : frames) map.frames.push_back({frame, {}, {}, {}});
  map.frames.front().T_cam_ref = SE3();
  map.frames.back().T_cam_ref = motion.T_cur_ref;
  for (std::size_t track = 0; track < motion.points.size(); ++track) {
    const auto& point = motion.points[track];
    if (!point) continue;
    const std::size_t corner = map.corners.size();
    map.corners.push_back(
        {tracks.positions[0][track].cast<double>(), point->inverse_depth, point->variance});
    if (!tracks.seen.empty()) {
      map.corners.back().shift = tracks.seen[track].cast<double>() - map.corners.back().pixel;
    }
    for (std::size_t frame = 1; frame < tracks.positions.size(); ++frame) {
      const Eigen::Vector2f& place = tracks.positions[frame][track];
      if (place.allFinite()) map.observations.push_back({corner, frame, place.cast<double>()});
    }
  }
  return map;
}

std::vector<std::size_t> poseFrames(InitialMap& map,
                                    const PinholeCamera& camera,
                                    const std::vector<std::size_t>& frames) {
  const auto has_pose = [&map](std::size_t frame) {
    return map.frames[frame].T_cam_ref.has_value();
  };
  if (std::all_of(frames.begin(), frames.end(), has_pose)) return {};
  const auto observations = observationsByFrame(map, camera);
  std::vector<std::size_t> posed;
  for (const std::size_t frame : frames) {
    std::optional<SE3>& pose = map.frames[frame].T_cam_ref;
    if (pose) continue;
    posed.push_back(frame);
    const SE3 guess = interpolatedPose(map, frame);
    pose = poseFromPoints(observations[frame], camera, guess, kTrackSigma).value_or(guess);
  }
  return posed;
}

std::vector<std::size_t> poseOtherFrames(InitialMap& map, const PinholeCamera& camera) {
  std::vector<std::size_t> frames(map.frames.size());
  std::iota(frames.begin(), frames.end(), std::size_t{0});
  return poseFrames(map, camera, frames);
}

std::vector<RowMotion> motionsByPoses(const InitialMap& map, const PinholeCamera& camera) {
  return motionsAlong(posesOf(map, camera));
}

void estimateMotions(InitialMap& map, const PinholeCamera& camera) {
  if (!isRolling(*map.frames.front().frame)) return;
  if (map.motions.empty()) normalizeCornerScale(map);
  const std::vector<TimedPose> poses = posesOf(map, camera);
  const std::vector<RowMotion> means = motionsAlong(poses);
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
    const bool between = k > 0 && k + 1 < means.size();
    const double share = between ? 0.5 : 1;
    map.motions[k].prior = {means[k], share * sigma, acceleration_sigma};
  }
  placeCorners(map, camera);
}

}  // namespace dsorb::init_orb
