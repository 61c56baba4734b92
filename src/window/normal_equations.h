// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "base/lanes.h"
#include "estimate/linear_system.h"
#include "window/pair_geometry.h"
#include "window/window.h"

#include <Eigen/Core>

#include <cstddef>
#include <cstdint>
#include <vector>

/// The way from sums over the residuals of an ordered pair of keyframes to the normal equations of
/// the absolute states.

/// The part of a window's normal equations that belongs to the velocities of rolling shutters. A
/// residual depends on the velocity of its target (host) as on its pose, times the time of the row
/// that sees (hosts) the point: products of derivatives by the relative pose, weighted with times,
/// are all that it takes.

namespace dsorb::window {

constexpr float kMinTexture = 2.0F;  // least weighted squared gradient of a residual [grey^2/px^2]

/// The photometric half of one residual: 8 pixels summed up, because they share one geometry. With
/// the weighted image gradient (x, y) and brightness derivatives (a, b) of every pixel, its
/// residual r, and the pattern summed: xx = sum of x x, and so on.
struct PatchSums {
  float xx = 0, xy = 0, yy = 0;
  float xa = 0, ya = 0, xb = 0, yb = 0;
  float aa = 0, ab = 0, bb = 0;
  float xr = 0, yr = 0, ar = 0, br = 0;
  float energy = 0;   ///< robust and weighted [grey levels^2]
  float texture = 0;  ///< sum of fourth powers of the weights times squared gradient
};

constexpr int kPoseRows = 6;
constexpr std::size_t kPoseLanes = 8;  ///< of a row that holds a pose alone

/// Lanes of a row of the pair's normal equations. The first eight are the relative state.
constexpr std::size_t kLaneA = 6;
constexpr std::size_t kLaneB = 7;
constexpr std::size_t kLaneResidual = 8;
constexpr std::size_t kLaneCamera = 9;
constexpr std::size_t kLaneReadout = kLaneCamera + kReadout;
constexpr std::size_t kRowLanes = 16;

/// The geometric half: derivatives of the pixel of the pattern's centre.
struct ResidualGeometry {
  /// Rows of d(u, v): [translation, rotation | a, b, r: zero | fx, fy, cx, cy, readout, radial
  /// scaled | zero].
  alignas(32) float x[kRowLanes] = {};
  alignas(32) float y[kRowLanes] = {};
  float depth_x = 0;  ///< du / d(inverse depth) [px unit]
  float depth_y = 0;
  // Rolling shutter: times of the rows that see and host the point [1 / kVelocityScale]. A velocity
  // moves the pixel as the pose does in that time, but for what is along the epipolar line.
  float target_time = 0;
  float host_time = 0;
};

/// Residuals of the pattern at the current state.
/// @param point host pixel, inverse depth, host intensities and weights
/// @return      false if any pixel leaves the image, lies behind the camera or is invalid
/// @source      Engel et al., DSO, arXiv:1607.02565, eq. (4); weight: mean of the host's and the
///              target's square roots of eq. (7), squared (DSO as published)
bool evaluatePatch(const WindowPoint& point,
                   const HostRays& rays,
                   const PairGeometry& pair,
                   PatchSums& sums);

/// What is estimated of the camera.
struct EstimatedCamera {
  bool intrinsics = false;
  bool readout = false;  ///< of a rolling shutter
  bool radial = false;   ///< distortion, beside the intrinsics

  [[nodiscard]] bool any() const { return intrinsics || readout; }
  /// @param row of the camera's state
  [[nodiscard]] bool has(Eigen::Index row) const {
    if (row == kReadout) return readout;
    return row == kRadial ? radial : intrinsics;
  }
};

/// Derivatives of the projected centre: poses at their first estimates, inverse depth and camera
/// current.
/// @param camera       also by the camera's state, scaled as that is, at constant motions
/// @return             false if the point is not in front of the target at the first estimates
/// @source             derived in photometric_residual_test; relative pose by left increments
bool evaluateGeometry(const WindowPoint& point,
                      const HostRays& rays,
                      const PairGeometry& pair,
                      EstimatedCamera camera,
                      ResidualGeometry& geometry);

/// Products of the residual with the rows of the pose.
/// @param x, y the patch block times geometry, brightness, residual: kRowLanes of them
DSORB_ALWAYS_INLINE Lanes residualColumn(const ResidualGeometry& g,
                                         const float* x,
                                         const float* y) {
  return x[kLaneResidual] * load(g.x) + y[kLaneResidual] * load(g.y);
}

/// Places of a pair in the system: first row of the state of a keyframe.
struct PairRows {
  Eigen::Index host = 0;
  Eigen::Index target = 0;
};

/// Sums of one ordered pair over one chunk: rows of the relative normal equations (translation,
/// rotation, camera; lanes as above) and the brightness block.
struct PairSums {
  alignas(32) float rows[kPoseRows + kCameraDim][kRowLanes];
  float residual[kPoseLanes];  // column of the residual in the rows of the pose
  float brightness[5];         // aa, ab, bb, ar, br
};

/// Sums over a chunk of points for one ordered pair. Lanes of a row as above;
/// times as in ResidualGeometry. Single precision is enough: priors hold the velocities.
struct VelocitySums {
  alignas(32) float by_target[kPoseRows][kRowLanes];  // times that of the target's row
  float by_host[kPoseRows][kRowLanes];
  float target_residual[kPoseLanes];  // column of the residual
  float host_residual[kPoseLanes];
  float target_target[kPoseRows][kPoseLanes];  // times its square, and so on
  float target_host[kPoseRows][kPoseLanes];
  float host_host[kPoseRows][kPoseLanes];
};

/// Adds one residual.
/// @param x, y   the patch block times geometry, brightness, residual: kRowLanes of them
/// @param camera whether there is more in them than pose, brightness and residual
DSORB_ALWAYS_INLINE void accumulateVelocities(
    const ResidualGeometry& g, const float* x, const float* y, bool camera, VelocitySums& sums) {
  static_assert(kPoseLanes == kLanes && kRowLanes - kPoseLanes == kLanes);
  const Lanes pose_x = load(x);
  const Lanes pose_y = load(y);
  for (std::size_t row = 0; row < kPoseRows; ++row) {
    const Lanes pose = g.x[row] * pose_x + g.y[row] * pose_y;
    const Lanes by_target = g.target_time * pose;
    const Lanes by_host = g.host_time * pose;
    addLanes(by_target, sums.by_target[row]);
    addLanes(by_host, sums.by_host[row]);
    addLanes(g.target_time * by_target, sums.target_target[row]);
    addLanes(g.target_time * by_host, sums.target_host[row]);
    addLanes(g.host_time * by_host, sums.host_host[row]);
  }
  const Lanes residual = residualColumn(g, x, y);
  addLanes(g.target_time * residual, sums.target_residual);
  addLanes(g.host_time * residual, sums.host_residual);
  if (!camera) return;
  const Lanes rest_x = load(x + kLanes);
  const Lanes rest_y = load(y + kLanes);
  for (std::size_t row = 0; row < kPoseRows; ++row) {
    const Lanes rest = g.x[row] * rest_x + g.y[row] * rest_y;
    addLanes(g.target_time * rest, sums.by_target[row] + kLanes);
    addLanes(g.host_time * rest, sums.by_host[row] + kLanes);
  }
}

/// Adds the sums of other points.
inline void add(const VelocitySums& other, VelocitySums& sums) {
  constexpr std::size_t kCount = sizeof(VelocitySums) / sizeof(float);
  const float* from = other.by_target[0];
  float* to = sums.by_target[0];
  for (std::size_t i = 0; i < kCount; ++i) to[i] += from[i];
}

/// Adds one pair to the system of absolute states.
void addVelocities(const VelocitySums& sums,
                   const PairGeometry& pair,
                   const PairRows& rows,
                   LinearSystem<float>& out);

/// A point by its place in the window.
struct PointRef {
  std::uint32_t keyframe = 0;
  std::uint32_t point = 0;
};

/// All points of a window, host by host.
[[nodiscard]] std::vector<PointRef> allPoints(const Window& window);

struct LinearizeOptions {
  EstimatedCamera camera{};       ///< estimated, too
  bool frozen = false;            ///< residuals extrapolated to the first estimates (marginals)
  bool depth_prior_pulls = true;  ///< false: the depth prior only adds curvature
  double depth_prior_factor = 1;  ///< on every depth prior
};

/// Gauss-Newton system of a window: camera and frames in scaled units, and inverse depths;
/// without the priors of camera and frames.
struct WindowEquations : LinearSystem<float> {
  double energy = 0;  ///< residuals, limited by their thresholds
  double depth_prior_energy = 0;
  int used = 0;  ///< residuals in the system
};

using WindowElimination = DepthElimination<float>;

/// Points of one host that are summed one after the other.
struct Chunk {
  std::size_t host = 0;
  std::size_t begin = 0;
  std::size_t end = 0;
  double energy = 0;
  double depth_prior_energy = 0;
  int used = 0;
};

/// Evaluates residuals and builds the system in one pass; owns the buffers it reuses. The result
/// has the same bits for any number of threads.
class NormalEquationsBuilder {
 public:
  /// Writes the trial values of all observations of the points and the system.
  /// @param points  sorted by keyframe
  void build(Window& window,
             const PairTable& pairs,
             const std::vector<PointRef>& points,
             const LinearizeOptions& options,
             WindowEquations& out);

 private:
  void split(const std::vector<PointRef>& points);
  void stitch(const Window& window, const PairTable& pairs, WindowEquations& out) const;

  std::vector<Chunk> chunks_;
  std::vector<PairSums> pair_sums_;          // chunk by target
  std::vector<VelocitySums> velocity_sums_;  // the same; rolling shutter only
};

/// Evaluates the residuals to the keyframes from a position on and sets what their outlier
/// thresholds rest on: trial states, kIn or kOutOfBounds, and raw energies.
/// @param points sorted by keyframe
void evaluateFrom(std::size_t first_target,
                  Window& window,
                  const PairTable& pairs,
                  const std::vector<PointRef>& points);

}  // namespace dsorb::window
