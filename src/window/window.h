// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"
#include "dsorb/image/affine_brightness.h"
#include "dsorb/image/frame.h"
#include "dsorb/options/brightness.h"
#include "dsorb/options/window.h"

#include "depth/candidate_activation.h"
#include "estimate/rolling_shutter.h"
#include "geometry/motion_prior.h"
#include "geometry/row_motion.h"
#include "image/pixel_selector.h"

#include <Eigen/Core>

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

namespace dsorb::window {

constexpr int kIntrinsicsDim = 4;         // fx, fy, cx, cy
constexpr int kReadout = kIntrinsicsDim;  // of a rolling shutter
constexpr int kRadial = kReadout + 1;     // radial distortion that the calibration lacks
constexpr int kCameraDim = kRadial + 1;
constexpr int kFrameDim = 8;     // translation, rotation, a, b
constexpr int kVelocityDim = 6;  // and of a rolling shutter's frame: its motion
constexpr std::size_t kMaxKeyframes = 12;

using Vector8d = Eigen::Matrix<double, kFrameDim, 1>;
using CameraVector = Eigen::Matrix<double, kCameraDim, 1>;

/// The state is kept in scaled units, physical = scale * state, so that blocks of the normal
/// equations have comparable magnitude: translation, rotation, a, b of a frame; intrinsics [px];
/// readout [s]; radial distortion.
/// @source DSO as published
inline Vector8d frameScale() {
  return (Vector8d() << .5, .5, .5, 1, 1, 1, 10, 1000).finished();
}
constexpr double kCameraScale = 50;
constexpr double kReadoutScale = 0.1;
constexpr double kRadialScale = 0.1;
/// Velocities have the scale of translation and rotation times this, about a row's time [1/s].
constexpr double kVelocityScale = 50;
inline Vector6d velocityScale() {
  return kVelocityScale * frameScale().head<6>();
}

/// Running number of a keyframe, never reused within a window.
struct KeyframeId {
  int value = -1;
  friend bool operator==(KeyframeId l, KeyframeId r) { return l.value == r.value; }
};

/// Running number of a point, never reused within a window.
struct PointId {
  int value = -1;
};

enum class ResidualState : std::uint8_t { kIn, kOutOfBounds, kOutlier };

/// One point seen in one keyframe. The trial values are those of the last evaluation; commit makes
/// them current.
struct Observation {
  std::uint8_t target = 0;  ///< position of the keyframe in the window
  ResidualState state = ResidualState::kIn;
  ResidualState trial_state = ResidualState::kIn;
  float energy = 0;        ///< limited by the outlier threshold
  float trial_energy = 0;  ///< limited
  float trial_raw = 0;     ///< not limited
};

/// State of a point's residual to one of the two newest keyframes.
struct RecentState {
  KeyframeId keyframe;
  ResidualState state = ResidualState::kIn;
};

/// A pixel of a keyframe with an inverse depth, part of the adjustment.
struct WindowPoint {
  PointId id;
  float inverse_depth = 0;        ///< [1/unit]
  float prior_inverse_depth = 0;  ///< value the prior pulls to [1/unit]
  float prior_information = 0;    ///< [grey levels^2 unit^2]
  float information = 0;          ///< curvature of the last solve, prior included
  float variance = 0;             ///< of the inverse depth, that of the poses included [1/unit^2]
  int good_observations = 0;      ///< used residuals, counted at every keyframe
  std::uint8_t num_observations = 0;
  std::array<Observation, kMaxKeyframes - 1> observations;
  std::array<RecentState, 2> recent;  ///< newest keyframe first
  HostPatch patch;                    ///< level 0

  [[nodiscard]] const Observation* begin() const { return observations.data(); }
  [[nodiscard]] const Observation* end() const { return begin() + num_observations; }
  [[nodiscard]] Observation* begin() { return observations.data(); }
  [[nodiscard]] Observation* end() { return begin() + num_observations; }
  /// @throws std::length_error when the point already has a residual to every other keyframe
  void addObservation(std::size_t target);
  /// Removes residuals for which `predicate(observation)` holds; keeps the order.
  template <typename Predicate>
  void removeObservations(Predicate predicate) {
    std::uint8_t kept = 0;
    for (std::uint8_t i = 0; i < num_observations; ++i) {
      if (!predicate(observations[i])) observations[kept++] = observations[i];
    }
    num_observations = kept;
  }
};

/// A frame of the window with its estimate, its points and its candidates. The estimate is
/// exp(scale * state) * T_cam_world_first, brightness = scale * state; `first` marks the value at
/// which Jacobians are taken.
struct Keyframe {
  KeyframeId id;
  FramePtr frame;
  RowMotion motion;  ///< while its rows are read; without a meaning for a global shutter
  Vector6d first_velocity = Vector6d::Zero();  ///< at which Jacobians are taken
  MotionPrior rows;                            ///< what its neighbours say of the motion
  SE3 T_cam_world_first;
  Vector8d first = Vector8d::Zero();  ///< pose part zero by construction
  Vector8d state = Vector8d::Zero();
  Vector8d prior = Vector8d::Zero();  ///< information, scaled units; pulls `state` to zero
  float energy_threshold = 0;         ///< of residuals to this keyframe
  bool leaves = false;                ///< flagged for marginalisation
  std::vector<WindowPoint> points;
  std::vector<depth::CandidatePoint> candidates;
  std::vector<WindowPoint> marginalized;  ///< left the adjustment, their information is kept
  int discarded = 0;                      ///< number of points thrown away

  [[nodiscard]] SE3 T_cam_world() const;
  [[nodiscard]] AffineBrightness affine() const;
  [[nodiscard]] AffineBrightness firstAffine() const;
  /// Scaled deviation of the velocity from a value.
  [[nodiscard]] Vector6d velocityFrom(const Vector6d& value) const {
    return (motion.velocity - value).cwiseQuotient(velocityScale());
  }
  /// Motion of a new keyframe, and what its neighbours say of it.
  void setMotion(const RowMotion& found, const MotionPrior& expected);
  /// Takes over what its neighbours say. The images tell no acceleration.
  void expect(const MotionPrior& expected) {
    rows = expected;
    motion.acceleration = expected.mean.acceleration;
  }
  /// Takes the current estimate as the value at which Jacobians are taken.
  void moveFirstEstimate();
};

/// Quadratic energy of what was marginalised: d^T H d + 2 b^T d, d = deviation of the state from
/// its first estimate; order: camera, then keyframes as in the window.
struct MarginalPrior {
  Eigen::MatrixXd H = Eigen::MatrixXd::Zero(kCameraDim, kCameraDim);
  Eigen::VectorXd b = Eigen::VectorXd::Zero(kCameraDim);
};

/// The window: keyframes, their points, the prior. A plain value with one owner; everything that
/// changes it is a function beside it.
struct Window {
  explicit Window(const PinholeCamera& initial_camera, BrightnessModel known = {})
      : first_camera(initial_camera),
        brightness(known),
        prior_focal(0.5 * (initial_camera.fx + initial_camera.fy)) {}

  PinholeCamera first_camera;
  BrightnessModel brightness;
  /// Scaled deviation of the intrinsics, of the readout and of the radial distortion.
  CameraVector camera_state = CameraVector::Zero();
  std::vector<Keyframe> keyframes;  ///< oldest first
  MarginalPrior prior;
  /// Whether velocities stay where the frames around them say: images show the product of velocity
  /// and readout, and beside a readout that may be 0 a velocity would explain anything.
  bool velocities_held = false;
  double readout_sigma = 0;  ///< of the estimated readout after the last adjustment [s]
  double prior_focal = 0;    ///< mean focal length of the camera that priors were made with [px]
  double prior_radial = 0;   ///< its radial distortion
  int forgotten = -1;        ///< newest keyframe when priors were last forgotten; -1: never
  /// Adapted minimum distance between points [px, half resolution]; it starts as published with
  /// DSO.
  double activation_distance = 2;
  int next_keyframe = 0;
  int next_point = 0;

  [[nodiscard]] PinholeCamera camera() const;
  /// What the adjustments have added to the calibrated camera.
  [[nodiscard]] CameraChange change() const {
    return {kReadoutScale * camera_state[kReadout], kRadialScale * camera_state[kRadial]};
  }
  /// Calibrated; a sigma above 0 says that the window estimates it.
  [[nodiscard]] Readout calibratedReadout() const {
    return keyframes.empty() ? Readout{} : readoutOf(*keyframes.front().frame);
  }
  /// Whether its readout is estimated and not yet told from 0, by three standard deviations.
  [[nodiscard]] bool mayBeGlobal() const {
    const Readout calibrated = calibratedReadout();
    return calibrated.sigma > 0 &&
           std::abs(calibrated.seconds + change().readout) <= 3 * readout_sigma;
  }
  /// How the rows of one of its keyframes move; nothing where the keyframe sees what a pinhole
  /// camera with a global shutter would.
  [[nodiscard]] std::optional<RollingShutter> shutter(const Keyframe& keyframe) const {
    return shutterOf(*keyframe.frame, keyframe.motion, change());
  }
  /// Whether the motions of its frames are estimated.
  [[nodiscard]] bool hasVelocities() const {
    return !keyframes.empty() && isRolling(*keyframes.front().frame);
  }
  /// Numbers in the state of a keyframe: kFrameDim, and its velocity.
  [[nodiscard]] int frameDimension() const {
    return hasVelocities() ? kFrameDim + kVelocityDim : kFrameDim;
  }
  /// Row of the first number of a keyframe's state.
  [[nodiscard]] Eigen::Index rowOf(std::size_t position) const {
    return kCameraDim + frameDimension() * static_cast<Eigen::Index>(position);
  }
  [[nodiscard]] int dimension() const { return static_cast<int>(rowOf(keyframes.size())); }
  [[nodiscard]] std::size_t numPoints() const;
  /// Stacked deviation of the state from the first estimate (dimension()).
  [[nodiscard]] Eigen::VectorXd deviation() const;
};

/// Appends a keyframe: enlarges the prior and gives every point of the others a residual to it.
/// @throws std::length_error when the window is full
Keyframe& addKeyframe(Window& window,
                      const FramePtr& frame,
                      const SE3& T_cam_world,
                      const AffineBrightness& affine,
                      const WindowOptions& options);

/// Sets the readout and how sure it is, where one was estimated.
void setReadout(Window& window, const std::optional<Readout>& readout);

/// Moves points to where a pinhole camera with a global shutter would have seen them at their
/// present inverse depths.
void placePoints(Window& window);
/// The same of candidates; one without inverse depth takes the mean of the points.
void placeCandidates(Window& window);

/// Appends a point without residuals.
/// @param prior_information of the inverse depth; 0 where nothing is known [grey levels^2 unit^2]
/// @return nullptr where its pattern leaves the image
WindowPoint* addPoint(Window& window,
                      Keyframe& host,
                      const Eigen::Vector2f& pixel,
                      float inverse_depth,
                      float prior_information);

/// Gives a point without residuals one to every keyframe but its host that satisfies a predicate.
template <typename Sees>
void addObservations(const Window& window, std::size_t host, Sees&& sees, WindowPoint& point) {
  const std::size_t newest = window.keyframes.size() - 1;
  for (std::size_t k = 0; k <= newest; ++k) {
    if (k == host || !sees(k)) continue;
    point.addObservation(k);
    if (newest - k < point.recent.size()) {
      point.recent[newest - k] = {window.keyframes[k].id, ResidualState::kIn};
    }
  }
}

/// Makes candidates of selected pixels; those too near the edge are left out.
void addCandidates(Keyframe& keyframe, const std::vector<SelectedPixel>& pixels);

/// Takes a keyframe out of the window and drops the residuals to it. The prior is not touched.
Keyframe removeKeyframe(Window& window, std::size_t position);

/// Energy threshold of a keyframe before any residual to it is known: 8 grey levels a pixel.
constexpr float kInitialThreshold = 8.0F * 8.0F * kPatternSize;

}  // namespace dsorb::window
