// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"

#include "estimate/pose_from_points.h"
#include "features/corner_tracks.h"
#include "geometry/row_motion.h"
#include "init/orb/map/initial_map.h"
#include "two_view/essential_motion.h"

#include <vector>

namespace dsorb::init_orb {

/// The attempt's first map: a corner for every track that is good under the motion, with its
/// observations in all frames that see it; the first and the last frame posed.
/// @param frames one a frame of the tracks
/// @param motion reference to newest frame, its points in the order of the tracks
InitialMap makeInitialMap(const std::vector<FramePtr>& frames,
                          const CornerTracks& tracks,
                          const MotionHypothesis& motion);

/// Observations of the corners, sorted by frame.
std::vector<std::vector<PointObservation>> observationsByFrame(const InitialMap& map,
                                                               const PinholeCamera& camera);

/// Poses some frames from the corners, each from where its nearest posed neighbours let expect it;
/// a frame whose corners do not agree is interpolated between them.
/// @param frames ascending; those that have a pose keep it
/// @return       those that had none
std::vector<std::size_t> poseFrames(InitialMap& map,
                                    const PinholeCamera& camera,
                                    const std::vector<std::size_t>& frames);

/// Poses all frames that have no pose yet. @return these frames
std::vector<std::size_t> poseOtherFrames(InitialMap& map, const PinholeCamera& camera);

/// Motion of every frame by the poses of the frames around it, those without a pose being posed
/// from the corners.
std::vector<RowMotion> motionsByPoses(const InitialMap& map, const PinholeCamera& camera);

/// Sets priors of the motions of all frames from the poses around them, as tightly as the poses
/// themselves show; and the motions, where there are none yet, with mean inverse depth 1. Moves the
/// corners' pixels by the motion of the reference. Nothing happens with a global shutter.
void estimateMotions(InitialMap& map, const PinholeCamera& camera);

}  // namespace dsorb::init_orb
