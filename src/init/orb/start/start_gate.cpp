// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/start/start_gate.h"

#include "base/angles.h"
#include "base/median.h"
#include "estimate/variance_factors.h"
#include "geometry/triangulate.h"
#include "init/wrong_direction.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <set>
#include <utility>
#include <vector>

namespace dsorb::init_orb {
namespace {

// Without the first two a start of a turning Kinect was 123 degrees off, with 58 corners.
constexpr int kMinCorners = 60;
constexpr double kMinTrackShare = 0.5;  // of the reference's live tracks that are left
constexpr double kMinFrontShare = 0.8;  // of the corners, in front of the camera
constexpr double kFartherShare = 0.75;  // of the corners, which are farther than the near part
/// An attempt is left out where the last one from this reference, extrapolated by the growth of the
/// parallax, misses the gate by more than this factor.
constexpr double kRetryMargin = 1.5;
constexpr int kMaxSkippedFrames = 1;       // but so many times in a row at most
constexpr std::size_t kGrownUpFrames = 8;  // of a start whose rows move; with fewer its direction
constexpr double kYoungSigmaDeg = 0.5;     // has to be as sure as this

}  // namespace

double depthSigma(const std::vector<Corner>& corners) {
  std::vector<double> inverse_depths;
  inverse_depths.reserve(corners.size());
  for (const Corner& corner : corners) inverse_depths.push_back(corner.inverse_depth);
  const double scene = quantileInPlace(inverse_depths, kFartherShare);
  std::vector<double> errors;
  errors.reserve(corners.size());
  for (const Corner& corner : corners) {
    errors.push_back(std::sqrt(corner.variance) / std::max(scene, corner.inverse_depth));
  }
  return medianInPlace(errors);
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

double misfitOf(double median_error) {
  return std::max(1.0, median_error / kMedianLength);
}

bool hasEnoughCorners(const InitialMap& map, int live_tracks) {
  const auto corners = static_cast<double>(map.corners.size());
  return corners >= kMinCorners && corners >= kMinTrackShare * live_tracks;
}

int occupiedCells(const InitialMap& map, const PinholeCamera& camera) {
  std::set<std::size_t> cells;
  for (const Corner& corner : map.corners) cells.insert(imageCell(corner.pixel, camera));
  return static_cast<int>(cells.size());
}

GateReport judgeStart(const InitialMap& map,
                      const PinholeCamera& camera,
                      const GateOptions& options,
                      const StartEvidence& evidence) {
  GateReport report;
  report.misfit = evidence.misfit;
  report.parallax_deg = medianParallaxDeg(map, camera);
  const Eigen::Vector2d sigmas =
      variance_factors::kStartDirection * directionSigmasDeg(map.frames.back());
  report.direction_sigma_deg = sigmas[1];
  report.second_sigma_deg = sigmas[0];
  report.depth_sigma = depthSigma(map.corners);
  report.error_probability = tailProbability(sigmas, options.wrong_angle_deg);
  if (evidence.plane_cost_ratio) {
    report.plane_probability = rivalProbability(*evidence.plane_cost_ratio,
                                                static_cast<double>(occupiedCells(map, camera)));
  }
  report.wrong_probability = 1 - (1 - report.error_probability) * (1 - report.plane_probability);
  if (!hasEnoughCorners(map, evidence.live_tracks)) {
    report.reason = InitReason::kTooFewPoints;
  } else if (evidence.front_share < kMinFrontShare ||
             !(report.plane_probability <= options.max_wrong_probability)) {
    report.reason = InitReason::kDegenerateMotion;
  } else if (!(report.depth_sigma <= options.max_depth_sigma)) {
    report.reason = InitReason::kTooLittleParallax;
  } else if (!(report.wrong_probability <= options.max_wrong_probability)) {
    report.reason = InitReason::kPoorQuality;
  }
  return report;
}

bool errorsPass(const GateReport& report, double shrunk_by, const GateOptions& options) {
  const Eigen::Vector2d sigmas(report.second_sigma_deg, report.direction_sigma_deg);
  return report.depth_sigma / shrunk_by <= options.max_depth_sigma &&
         tailProbability(sigmas / shrunk_by, options.wrong_angle_deg) <=
             options.max_wrong_probability;
}

bool refusedUnless(double larger,
                   const AttemptSummary& last,
                   double rotation_residual,
                   const GateOptions& gate) {
  return last.gate &&
         !errorsPass(*last.gate, larger * rotation_residual / last.rotation_residual, gate);
}

bool isYoung(const ReferenceView& view, double direction_sigma_deg) {
  const bool rows_move = view.readout && view.readout->seconds != 0;
  return rows_move && view.frames.size() < kGrownUpFrames && direction_sigma_deg > kYoungSigmaDeg;
}

bool worthTheTime(const ReferenceView& view, double rotation_residual, const GateOptions& gate) {
  const AttemptSummary& last = view.last;
  const bool was_young = last.gate && last.reason == InitReason::kSettling;
  if (was_young) return view.frames.size() >= kGrownUpFrames;
  return last.skipped >= kMaxSkippedFrames ||
         !refusedUnless(kRetryMargin, last, rotation_residual, gate);
}

}  // namespace dsorb::init_orb
