// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/geometry/se3.h"
#include "dsorb/image/frame.h"

#include "synthetic/scene.h"

#include <cstdint>
#include <vector>

namespace dsorb::synthetic {

// Camera paths as smooth functions of time, in the axes of the places: x right, y down, z ahead.

/// Mean way of the street drive [m per frame]; single frames lie between 1.0 and 1.3 m.
constexpr double kStreetStep = 1.15;

/// @param frame time in frames, fractions allowed @param seed start phase
/// @return T_world_cam
[[nodiscard]] SE3 streetPose(double frame, std::uint64_t seed);
[[nodiscard]] SE3 blockPose(double frame, std::uint64_t seed);
[[nodiscard]] SE3 roundPose(double frame, std::uint64_t seed);
[[nodiscard]] SE3 roomPose(double frame, std::uint64_t seed);
[[nodiscard]] SE3 planePose(double frame, std::uint64_t seed);
/// Position of roomPose(0), turning.
[[nodiscard]] SE3 rotationPose(double frame, std::uint64_t seed);

/// Pose of the box that moves by itself: a car ahead on the street, a crate elsewhere.
[[nodiscard]] SE3 movingCarPose(double frame, std::uint64_t seed);
/// Pose of the middle of a box that stays as far ahead of the street's camera and swerves.
/// @param ahead  middle to camera [m]
/// @param height of the middle above the street [m]
[[nodiscard]] SE3 movingVanPose(double frame, std::uint64_t seed, double ahead, double height);
[[nodiscard]] SE3 movingCratePose(double frame, std::uint64_t seed);

/// Pixel value of a light intensity; the curve of the simulated camera, or a straight line.
/// @param irradiance [grey levels]; clipped to [0, 255] @return [grey levels], not rounded
[[nodiscard]] double forwardResponse(double irradiance, bool nonlinear);

/// Light intensity of the pixel values 0 to 255 [grey levels, 0 to 255], strictly increasing.
[[nodiscard]] std::vector<double> makeInverseResponse(bool nonlinear);

/// Share of the light that arrives at each pixel, 1 in the middle; all 1 without vignette.
[[nodiscard]] std::vector<float> makeVignette(int width, int height, bool enabled);

/// Settings of one exposure.
struct Exposure {
  double gain = 1;         ///< exposure time over the nominal one
  bool nonlinear = false;  ///< response
  double noise_sigma = 0;  ///< [grey levels]
  std::uint64_t seed = 0;  ///< of the noise
};

/// Turns light into pixel values: vignette, exposure, response, noise, rounding.
/// @param irradiance [grey levels] row-major @param vignette of the same size
[[nodiscard]] std::vector<std::uint8_t> expose(const std::vector<float>& irradiance,
                                               const std::vector<float>& vignette,
                                               int width,
                                               const Exposure& exposure);

enum class SequenceKind {
  kStreet,    ///< forward drive between facades and parked cars, 10 Hz, about 1.15 m per frame
  kRoom,      ///< hand-held or flying camera in a furnished room, 30 Hz, 1.5 to 3 cm per frame
  kPlane,     ///< general motion before one plane, 30 Hz, about 4 cm per frame
  kStatic,    ///< the camera of kRoom stands still
  kRotation,  ///< the camera of kRoom turns about its centre
  kCut,       ///< kRoom; in the middle another room begins
  kBlock,     ///< kStreet round a block of houses, 226 frames once
  kRound,     ///< the camera goes round in kRoom and looks at the walls, 262 frames once
};

struct SequenceOptions {
  SequenceKind kind = SequenceKind::kRoom;
  int width = 640;                  ///< [px]
  int height = 480;                 ///< [px]
  double fx = 0;                    ///< focal length [px]; 0: 0.58 width for kStreet, else 0.625
  int length = 60;                  ///< frames
  std::uint64_t seed = 1;           ///< texture, layout, path and noise
  double noise_sigma = 0;           ///< of the 8-bit values [grey levels]
  double exposure_changes = 0;      ///< amplitude of the log exposure [-]; 0: constant
  bool nonlinear_response = false;  ///< camera response that is not a straight line
  bool vignette = false;            ///< darker corners
  double light = 1;                 ///< in the place, of what just does not saturate
  double motion_blur = 0;           ///< open time of the shutter [share of the frame interval]
  /// Time from the exposure of the first row to that of the last, negative when the last comes
  /// first [s]; pose and depth of a frame are those of its middle row. 0: global shutter.
  double readout = 0;
  double speed = 1;  ///< of everything that moves, times the usual one
  double rate = 0;   ///< [frames/s]; 0: 10 of kStreet, else 30
  /// Speed of the camera of kStreet, times `speed`; 0: it stands in the traffic.
  double camera_speed = 1;
  bool moving_object = false;  ///< a box that moves by itself
  /// Share of the first image of kStreet that the box covers: a van close ahead that swerves;
  /// 0: a car farther ahead.
  double moving_object_share = 0;
  bool moving_object_plain = false;  ///< no texture on the box
  RenderOptions rendering;
};

/// One frame as the camera delivers it.
struct SyntheticFrame {
  int width = 0;
  int height = 0;
  std::vector<std::uint8_t> image;   ///< row-major, after blur, vignette, exposure, response, noise
  std::vector<float> inverse_depth;  ///< row-major [1/m], at the middle of the exposure; 0: sky
  SE3 T_world_cam;                   ///< at the middle of the exposure
  double timestamp = 0;              ///< [s]
  double exposure = 0;               ///< [s]
  bool moving_object_visible = false;

  [[nodiscard]] ImageView view() const { return {image.data(), width, height}; }
  [[nodiscard]] float inverseDepthAt(int x, int y) const {
    return inverse_depth[static_cast<std::size_t>(y) * static_cast<std::size_t>(width) +
                         static_cast<std::size_t>(x)];
  }
};

/// Rendered sequence with its truth. Frames are made on demand, in any order and from any thread;
/// the same options give the same bits.
class SyntheticSequence {
 public:
  /// @throws std::invalid_argument on options out of range
  explicit SyntheticSequence(const SequenceOptions& options);

  [[nodiscard]] const SequenceOptions& options() const { return options_; }
  [[nodiscard]] int length() const { return options_.length; }
  [[nodiscard]] const PinholeCamera& camera() const { return camera_; }

  /// @throws std::out_of_range on an index outside [0, length)
  [[nodiscard]] SE3 pose(int index) const;  ///< T_world_cam
  [[nodiscard]] double timestamp(int index) const;
  [[nodiscard]] double exposure(int index) const;  ///< [s]
  [[nodiscard]] SyntheticFrame frame(int index) const;
  [[nodiscard]] std::vector<float> inverseDepth(int index) const;

  /// The frame as odometry gets it: response and vignette undone; the id is the index.
  [[nodiscard]] FramePtr framePtr(int index) const;
  [[nodiscard]] FramePtr framePtr(const SyntheticFrame& frame, int index) const;

  /// Inverse response: irradiance [grey levels, 0 to 255] of the 256 pixel values.
  [[nodiscard]] const std::vector<double>& inverseResponse() const { return inverse_response_; }
  /// Share of the light that arrives at each pixel (0, 1], row-major.
  [[nodiscard]] const std::vector<float>& vignette() const { return vignette_; }
  /// Whether response, vignette or exposure need a photometric calibration.
  [[nodiscard]] bool isPhotometric() const;
  /// Whether the camera's motion allows to triangulate at all.
  [[nodiscard]] bool hasParallax() const;

 private:
  [[nodiscard]] int actOf(int index) const;
  [[nodiscard]] SE3 poseAt(int act, double frame) const;
  [[nodiscard]] SE3 movingBoxPose(int act, double frame) const;
  [[nodiscard]] Moment momentAt(int act, double frame) const;
  /// Image of a camera that reads its rows one after the other, its middle row at `frame`.
  [[nodiscard]] View renderAt(int act, double frame) const;
  [[nodiscard]] std::vector<float> inverseDepthAt(int act, double frame) const;
  [[nodiscard]] std::vector<float> blurredIntensity(int index, View& centre) const;

  SequenceOptions options_;
  PinholeCamera camera_;
  std::vector<Scene> acts_;  ///< two for kCut, else one
  int moving_box_ = -1;
  std::vector<double> inverse_response_;
  std::vector<float> vignette_;
};

}  // namespace dsorb::synthetic
