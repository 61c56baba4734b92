// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"
#include "dsorb/image/affine_brightness.h"
#include "dsorb/image/pyramid.h"
#include "dsorb/options/depth.h"

#include "depth/candidate_point.h"
#include "estimate/epipolar_geometry.h"
#include "estimate/host_patch.h"
#include "estimate/rolling_shutter.h"

#include <cstddef>
#include <optional>
#include <vector>

namespace dsorb::depth {

/// Everything a search needs of a host and a posed frame; one for all candidates of the host.
struct EpipolarPair {
  EpipolarPair(const PinholeCamera& of_both,
               const SE3& T_frame_host,
               const BrightnessTransfer& transfer)
      : warp(makeWarp<float>(of_both, T_frame_host)),
        rays(of_both),
        geometry(of_both, T_frame_host),
        gain(static_cast<float>(transfer.gain)),
        offset(static_cast<float>(transfer.offset)) {}

  Warp<float> warp;
  HostRays rays;
  EpipolarGeometry geometry;
  float gain, offset;                       ///< brightness, host to frame
  std::optional<RollingShutter> shutter{};  ///< of the frame
};

/// Refines the inverse-depth interval of one candidate with one posed frame: discrete search along
/// the epipolar line, sub-pixel refinement, new interval from the expected error.
/// @param level  level 0 of the frame
/// @note         a match replaces the interval; intervals are not fused
/// @source       Engel et al., DSO, arXiv:1607.02565, section 3.2; error model: Engel et al.,
///               Semi-Dense Visual Odometry for a Monocular Camera, section 2.1
void searchEpipolarLine(CandidatePoint& candidate,
                        const EpipolarPair& pair,
                        const PyramidLevel& level,
                        const DepthOptions& options);

/// The same for all candidates of one host.
/// @param grain  candidates in a parallel task; 0 runs serially
void searchEpipolarLines(std::vector<CandidatePoint>& candidates,
                         const EpipolarPair& pair,
                         const PyramidLevel& level,
                         const DepthOptions& options,
                         std::size_t grain);

}  // namespace dsorb::depth
