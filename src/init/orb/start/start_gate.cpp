// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/start/start_gate.h"

#include "base/median.h"
#include "geometry/symmetric_eigen.h"
#include "geometry/triangulate.h"
#include "init/orb/bundle/reprojection_equations.h"
#include "init/orb/tracks/image_scale.h"
#include "init/orb/two_view/motion_refinement.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>
#include <vector>

namespace dsorb::init_orb {
namespace {

constexpr double kDegPerRad = 180.0 / M_PI;
constexpr double kReferenceCorners = 100;  // the predicted error is scaled to this many

}  // namespace

DirectionSigma directionSigma(const InitialMap& map,
                              const PinholeCamera& camera,
                              const GeometricOptions& options) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  constexpr DirectionSigma kUnknown{kInfinity, kInfinity};
  const GeometricMarginals joint(map, camera, options);
  if (!joint.variance_factor) return kUnknown;
  const Eigen::Vector3d& t = map.frames.back().T_cam_ref->translation();
  Eigen::MatrixXd perpendicular = Eigen::MatrixXd::Zero(joint.rows.size, 2);
  perpendicular.middleRows<3>(joint.rows.first.back()) = tangentBasis(t.normalized());
  const Eigen::VectorXd unit_scale = joint.scale.normalized();
  perpendicular -= unit_scale * (unit_scale.transpose() * perpendicular);
  const Eigen::Matrix2d covariance =
      perpendicular.transpose() * joint.marginals.solve(perpendicular);
  const double variance = symmetricEigen(covariance).values[1];
  if (!(variance >= 0)) return kUnknown;
  const double sigma = std::sqrt(variance) / t.norm();
  return {sigma, sigma * std::sqrt(*joint.variance_factor)};
}

double medianParallaxDeg(const InitialMap& map, const PinholeCamera& camera) {
  const std::size_t newest = map.frames.size() - 1;
  std::vector<double> angles;
  for (const CornerObservation& observation : map.observations) {
    if (observation.frame != newest) continue;
    const Corner& corner = map.corners[observation.corner];
    angles.push_back(parallaxAngle(*map.frames.back().T_cam_ref,
                                   camera.unproject(corner.pixel),
                                   camera.unproject(observation.pixel)));
  }
  return medianOf(std::move(angles)) * kDegPerRad;
}

double neededParallaxDeg(const GateOptions& gate, double direction_sigma_deg) {
  return direction_sigma_deg <= gate.sharp_sigma_deg
             ? std::min(gate.sharp_parallax_deg, gate.min_parallax_deg)
             : gate.min_parallax_deg;
}

GateReport judgeStart(const InitialMap& map,
                      const PinholeCamera& camera,
                      const OrbOptions& options,
                      int live_tracks,
                      double front_share) {
  const GateOptions& gate = options.gate;
  const auto corners = static_cast<double>(map.corners.size());
  GateReport report;
  report.parallax_deg = medianParallaxDeg(map, camera);
  const DirectionSigma sigma = directionSigma(map, camera, options.geometric);
  // Small images are tracked as well as large ones, in pixels of the large ones.
  const double scale = std::min(1.0, imageScale(camera.width, camera.height));
  report.direction_sigma_deg =
      scale * sigma.predicted * std::sqrt(corners / kReferenceCorners) * kDegPerRad;
  report.fitted_sigma_deg = sigma.fitted * kDegPerRad;
  if (corners < gate.min_points || corners < gate.min_track_share * live_tracks) {
    report.reason = InitReason::kTooFewPoints;
  } else if (front_share < gate.min_front_share) {
    report.reason = InitReason::kDegenerateMotion;
  } else if (report.parallax_deg < neededParallaxDeg(gate, report.direction_sigma_deg)) {
    report.reason = InitReason::kTooLittleParallax;
  } else if (!(report.direction_sigma_deg <= gate.max_direction_sigma_deg &&
               report.fitted_sigma_deg <= gate.max_fitted_sigma_deg)) {
    report.reason = InitReason::kPoorQuality;
  }
  return report;
}

}  // namespace dsorb::init_orb
