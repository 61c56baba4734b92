// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "dsorb/geometry/se3.h"

#include <Eigen/Core>

#include <cstddef>
#include <vector>

namespace dsorb::self_calibration {

/// Numbers of a camera: logarithm of fx [px], cx, cy [px], k1, k2, k3, readout [s], what the first
/// one grows by from the first view to the last, and the logarithm of fy over fx.
constexpr int kLogFocal = 0;
constexpr int kCenter = 1;
constexpr int kRadial = 3;
constexpr int kReadout = 6;
constexpr int kZoom = 7;
constexpr int kAspect = 8;
constexpr int kLensDim = 9;
using LensVector = Eigen::Matrix<double, kLensDim, 1>;

/// What is known of the numbers beforehand; one without a standard deviation is held.
struct LensPrior {
  LensVector mean;
  LensVector sigma;
  double shift_sigma = 0;  ///< of the image of a view; 0: shifts are held [px]
};

/// A corner in a view.
struct Sight {
  std::size_t view = 0;
  std::size_t corner = 0;
  Eigen::Vector2d pixel;  ///< of the image as it was taken [px]
  /// Velocity times the share of the readout at which the corner's row is read, -1/2 to 1/2 [px/s].
  Eigen::Vector2d drift = Eigen::Vector2d::Zero();
};

/// Views, corners and their camera: what an adjustment moves.
struct Scene {
  std::vector<SE3> views;                 ///< T_cam_world
  std::vector<Eigen::Vector2d> shifts{};  ///< of their images, which a crop that moves has [px]
  std::vector<Eigen::Vector3d> corners;   ///< world coordinates
  LensVector lens;
  std::vector<Sight> sights;  ///< sorted by corner; neither moved nor changed
};

/// Places the corners by the rays of their sights. Those that land behind a view that sees them
/// are left out with their sights.
/// @source Hartley, Zisserman, Multiple View Geometry, section 12.2 (linear triangulation)
void placeCorners(Scene& scene);

/// Leaves out corners with a sight whose error is above a limit [px].
void leaveOutAbove(double limit, Scene& scene);

/// Distance of each sight from where the camera sees its corner; infinite behind it [px].
[[nodiscard]] std::vector<double> sightErrors(const Scene& scene);

/// Moves all to the minimum of a robust cost.
/// @param noise of a sight [px]
/// @return the cost: squared standard deviations, robust, that of the prior included
/// @source Triggs et al., Bundle Adjustment - A Modern Synthesis, section 6.1 (Schur complement)
double adjust(const LensPrior& prior, double noise, int max_iterations, Scene& scene);

/// Standard deviations of the lens after an adjustment, as errors of sights that are independent
/// make it; 0 of what is held.
[[nodiscard]] LensVector lensSigmas(const LensPrior& prior, double noise, const Scene& scene);

/// What the logarithm of the focal length grows by from the first view to the last.
struct FocalChange {
  double relative = 0;
  double sigma = 0;  ///< as errors of sights that are independent make it
};

/// @param scene after an adjustment of a focal length that stays
[[nodiscard]] FocalChange focalChange(LensPrior prior,
                                      double noise,
                                      int max_iterations,
                                      Scene scene);

/// What views gain by an image that is shifted in each of them.
struct ViewShifts {
  double rms = 0;    ///< [px]
  double gain = 0;   ///< of the cost, for each view
  double focal = 0;  ///< what the logarithm of the focal length changes by
};

/// @param sigma of a shift beforehand [px]
/// @param scene after an adjustment without shifts
[[nodiscard]] ViewShifts viewShifts(
    LensPrior prior, double noise, double sigma, int max_iterations, Scene scene);

}  // namespace dsorb::self_calibration
