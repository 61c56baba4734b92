// SPDX-License-Identifier: BSD-3-Clause
#include "init/orb/map/initial_map.h"

#include "estimate/robust_loss.h"
#include "init/result.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace dsorb::init_orb {
namespace {

bool handedOver(double inverse_depth, double variance) {
  return std::isfinite(inverse_depth) && inverse_depth > 0 && std::isfinite(variance) &&
         variance > 0;
}

/// Makes this inverse depth 1. @return false when it is not positive
bool rescale(InitialMap& map, double mean) {
  if (!(mean > 0) || !std::isfinite(mean)) return false;
  for (Corner& corner : map.corners) {
    changeUnit(mean, corner.inverse_depth, corner.variance);
    changeUnit(mean, corner.known.mean, corner.known.variance);
  }
  for (InitPoint& point : map.points) changeUnit(mean, point.inverse_depth, point.variance);
  changeUnit(mean, map.frames);
  map.metres /= mean;
  for (FrameMotion& motion : map.motions) {
    motion.found.changeUnit(mean);
    motion.prior.changeUnit(mean);
  }
  for (Eigen::Index row = 0; row < map.joint_covariance.rows(); ++row) {
    if (row % 6 >= 3) continue;  // a rotation
    map.joint_covariance.row(row) *= mean;
    map.joint_covariance.col(row) *= mean;
  }
  return true;
}

}  // namespace

KnownTerm knownTerm(const KnownInverseDepth& known, double inverse_depth) {
  const double error = (inverse_depth - known.mean) / std::sqrt(known.variance);
  double ratio = 1;
  double weight = 1;
  cauchyWeights(error * error, kCauchyLimit, ratio, weight);
  return {weight / known.variance,
          weight * error / std::sqrt(known.variance),
          0.5 * kCauchyLimit * kCauchyLimit * std::log(ratio),
          weight * error * error};
}

BrightnessTransfer brightnessTo(const InitialMap& map, std::size_t frame) {
  const PosedFrame& from = map.frames.front();
  const PosedFrame& to = map.frames[frame];
  return brightnessTransfer(from.affine, from.frame->exposure(), to.affine, to.frame->exposure());
}

std::optional<RollingShutter> shutterOf(const InitialMap& map, std::size_t frame, int level) {
  if (map.motions.empty()) return std::nullopt;
  const Frame& of = *map.frames[frame].frame;
  const double change = map.readout ? map.readout->seconds - readoutOf(of).seconds : 0;
  return makeRollingShutter(rowTimesOf(of, change), map.motions[frame].found, level);
}

void placeCorners(InitialMap& map, const PinholeCamera& camera) {
  const std::optional<RollingShutter> shutter = shutterOf(map, 0);
  if (!shutter) return;
  for (Corner& corner : map.corners) {
    const Eigen::Vector2d seen = corner.pixel + corner.shift;
    corner.pixel =
        pixelInMiddle(
            *shutter, camera, seen.cast<float>(), static_cast<float>(corner.inverse_depth))
            .cast<double>();
    corner.shift = seen - corner.pixel;
  }
}

Eigen::Index jointRow(const InitialMap& map, std::size_t frame) {
  const auto found = std::find(map.joint_frames.begin(), map.joint_frames.end(), frame);
  return found == map.joint_frames.end() ? -1 : 6 * (found - map.joint_frames.begin());
}

void setJointCovariance(InitialMap& map,
                        std::vector<std::size_t> frames,
                        const Eigen::MatrixXd& joint) {
  map.joint_frames = std::move(frames);
  map.joint_covariance = joint;
  Eigen::Index row = 0;
  for (const std::size_t frame : map.joint_frames) {
    map.frames[frame].covariance = joint.block<6, 6>(row, row);
    row += 6;
  }
}

void widenCovariances(InitialMap& map, double factor) {
  const double variance = factor * factor;
  setJointCovariance(map, map.joint_frames, variance * map.joint_covariance);
  for (Corner& corner : map.corners) corner.variance *= variance;
}

int removeCorners(InitialMap& map, const std::vector<char>& removed) {
  std::vector<std::size_t> new_index;
  new_index.reserve(removed.size());
  std::size_t next = 0;
  for (const char gone : removed) new_index.push_back(gone == 0 ? next++ : next);
  eraseMarked(removed, map.corners);
  std::size_t kept = 0;
  for (const CornerObservation& observation : map.observations) {
    if (removed[observation.corner] != 0) continue;
    map.observations[kept] = observation;
    map.observations[kept++].corner = new_index[observation.corner];
  }
  map.observations.resize(kept);
  return static_cast<int>(removed.size() - next);
}

std::vector<InitPoint> pointsOf(const InitialMap& map) {
  std::vector<int> observations(map.corners.size(), 0);
  for (const CornerObservation& observation : map.observations) {
    ++observations[observation.corner];
  }
  std::vector<InitPoint> points;
  for (std::size_t i = 0; i < map.corners.size(); ++i) {
    const Corner& corner = map.corners[i];
    if (!handedOver(corner.inverse_depth, corner.variance)) continue;
    points.push_back({0,
                      corner.seen(),
                      static_cast<float>(corner.inverse_depth),
                      static_cast<float>(corner.variance),
                      observations[i]});
  }
  for (const InitPoint& point : map.points) {
    if (handedOver(point.inverse_depth, point.variance)) points.push_back(point);
  }
  return points;
}

bool normalizeCornerScale(InitialMap& map) {
  double mean = 0;
  for (const Corner& corner : map.corners) {
    mean += corner.inverse_depth / static_cast<double>(map.corners.size());
  }
  return rescale(map, mean);
}

}  // namespace dsorb::init_orb
