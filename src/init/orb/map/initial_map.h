// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/camera/calibration.h"
#include "dsorb/camera/pinhole_camera.h"
#include "dsorb/image/affine_brightness.h"
#include "dsorb/image/frame_priors.h"
#include "dsorb/init/result.h"

#include "estimate/rolling_shutter.h"
#include "geometry/motion_prior.h"
#include "geometry/row_motion.h"
#include "image/cell_grid.h"

#include <Eigen/Core>

#include <cstddef>
#include <limits>
#include <optional>
#include <vector>

namespace dsorb::init_orb {

/// Points within it tell of each other, for an image diagonal of 800 px [px].
constexpr double kNeighbourRadius = 60;

/// Inverse depth that the caller knows, as a Gaussian in the map's unit.
struct KnownInverseDepth {
  double mean = 0;      ///< [1/unit]
  double variance = 0;  ///< [1/unit^2]; 0: nothing is known
  explicit operator bool() const { return variance > 0; }
};

/// Corner hosted in the reference. Its pixel is exact because the patch was cut there.
struct Corner {
  Eigen::Vector2d pixel{0, 0};  ///< in the reference, all of it exposed at one time [px]
  double inverse_depth = 0;     ///< [1/unit]
  double variance = 0;          ///< [1/unit^2]; 0 until an adjustment has set it
  Eigen::Vector2d shift{0, 0};  ///< from there to where a rolling shutter shows it [px]
  KnownInverseDepth known{};    ///< by the caller

  [[nodiscard]] Eigen::Vector2f seen() const { return (pixel + shift).cast<float>(); }
};

/// Observation of a corner in a later frame.
struct CornerObservation {
  std::size_t corner = 0;  ///< index into InitialMap::corners
  std::size_t frame = 0;   ///< index into InitialMap::frames, at least 1
  Eigen::Vector2d pixel{0, 0};
  /// Inverse square root of the pixel's covariance over the options' sigma^2.
  Eigen::Matrix2d whitening = Eigen::Matrix2d::Identity();
};

/// Motion between two frames that the caller knows.
struct KnownMotion {
  static constexpr std::size_t kReference = std::numeric_limits<std::size_t>::max();
  std::size_t from = 0;  ///< index into InitialMap::frames
  std::size_t to = 0;    ///< a later one
  SE3 T_to_from;         ///< [m]
  /// Information of the error, [translation; rotation]: differences of the two translations and of
  /// the two rotations; zeros where nothing is known of the translation [1/m^2, 1/rad^2].
  Matrix6d information = Matrix6d::Zero();
  bool has_translation = false;
};

/// Motion of a frame while its rows are read.
struct FrameMotion {
  RowMotion found;      ///< by the corners
  MotionPrior prior{};  ///< what the poses around say of it
};

/// Map of an attempt with all frames since the reference.
struct InitialMap {
  std::vector<PosedFrame> frames;         ///< front is the reference: identity, a = b = 0
  std::vector<std::size_t> joint_frames;  ///< adjusted together, ascending, without the reference
  Eigen::MatrixXd joint_covariance;       ///< of the joint frames' left increments, 6 rows each
  double cluster_variance_scale = 0;      ///< factor on the clustered part of the covariance [-]
  std::vector<Corner> corners;
  std::vector<CornerObservation> observations;  ///< sorted by corner, then frame
  std::vector<InitPoint> points;                ///< beside the corners, of the reference
  /// One a frame; empty: global shutter, or not known yet.
  std::vector<FrameMotion> motions{};
  std::optional<Readout> readout{};          ///< of a rolling shutter, calibrated or estimated
  std::vector<KnownMotion> known_motions{};  ///< between frames, by the caller; take part
  std::vector<Eigen::Vector2f> stuck{};      ///< pixels that move with the camera
  /// Metres of one unit where known depths have given the map its scale, which is no free gauge
  /// then; 0: nothing is known.
  double metres = 0;

  [[nodiscard]] bool scaleKnown() const { return metres > 0; }
};

/// What a known inverse depth adds to the equations of an estimated one: a Cauchy loss of their
/// difference over its standard deviation.
struct KnownTerm {
  double hessian = 0;
  double gradient = 0;
  double cost = 0;             ///< half the loss
  double weighted_square = 0;  ///< w e^2 [-]
};
KnownTerm knownTerm(const KnownInverseDepth& known, double inverse_depth);

/// Rolling shutter of a frame's image; nothing where all of it counts as exposed at one time.
std::optional<RollingShutter> shutterOf(const InitialMap& map, std::size_t frame);

/// Moves the corners' pixels to where a global shutter would have seen them, by the reference's
/// motion.
void placeCorners(InitialMap& map, const PinholeCamera& camera);

/// Brightness of the reference to that of a frame.
BrightnessTransfer brightnessTo(const InitialMap& map, std::size_t frame);

/// Sets the joint covariance, and from it that of every frame in it; other frames keep theirs.
/// @param frames ascending, without the reference
/// @param joint  of their left increments, 6 rows each
void setJointCovariance(InitialMap& map,
                        std::vector<std::size_t> frames,
                        const Eigen::MatrixXd& joint);
/// Multiplies all standard deviations: of poses and of corners.
void widenCovariances(InitialMap& map, double factor);

/// Corners and points as they are handed over; those at or behind infinity are left out.
std::vector<InitPoint> pointsOf(const InitialMap& map);

/// Removes the marked corners with their observations. @param removed one a corner
void removeCorners(InitialMap& map, const std::vector<char>& removed);

/// Makes the mean inverse depth of the corners 1; poses, covariances and variances change their
/// unit with it.
/// @return false when that mean is not positive; nothing is changed then
bool normalizeCornerScale(InitialMap& map);

/// Reads the inverse depth at any pixel from a frame's known depths. Refers to them.
class DepthLookup {
 public:
  /// @param metres    of a unit
  /// @param inflation of the claimed standard deviations [-]
  DepthLookup(const DepthPrior& prior, double metres, double inflation)
      : prior_(prior), metres_(metres), inflation_(inflation) {}

  /// The depth of the pixel with the spread of its eight neighbours, which is wide at an edge of
  /// depth; where the pixel has none, the mean of the known ones within a few pixels, as wide as a
  /// guess. Nothing where there are none, either.
  [[nodiscard]] KnownInverseDepth at(const Eigen::Vector2f& pixel) const;

 private:
  const DepthPrior& prior_;
  double metres_;
  double inflation_;
};

/// Sets the brightness of every posed frame after the reference: gain and offset between the grey
/// values around the corners in the reference and where they are seen, by a robust line through the
/// patch means. A frame with too few corners or too little contrast keeps a = b = 0.
/// @source Engel et al., DSO, arXiv:1607.02565, eq. (4) for the meaning of a and b
void estimateBrightness(InitialMap& map, const PinholeCamera& camera);

}  // namespace dsorb::init_orb
