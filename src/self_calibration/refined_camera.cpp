// SPDX-License-Identifier: BSD-3-Clause
#include "self_calibration/refined_camera.h"

#include <algorithm>
#include <cmath>
#include <limits>

namespace dsorb {
namespace {

constexpr double kWanted = 0.01;  // of the focal length
constexpr double kSigmas = 3;     // that a distortion must differ from none by

double meanFocal(const PinholeCamera& camera) {
  return 0.5 * (camera.fx + camera.fy);
}

}  // namespace

void RefinedCamera::add(const KeyframeSnapshot& keyframe) {
  if (keyframe.segment != segment_) {
    focal_lengths_.clear();
    segment_ = keyframe.segment;
    frames_.clear();
  }
  if (frames_.insert(keyframe.id).second) focal_lengths_.push_back(0);
  focal_lengths_.back() = meanFocal(keyframe.camera);
  const Estimate newest = {
      keyframe.camera, keyframe.camera_sigmas, keyframe.radial, movement(), keyframe.segment};
  const bool same_segment = known_.segment == newest.segment;
  if (same_segment || focalSigma(newest) <= focalSigma(known_)) known_ = newest;
}

double RefinedCamera::focalSigma(const Estimate& estimate) {
  if (!estimate.camera || !estimate.sigmas) return std::numeric_limits<double>::infinity();
  const auto& sigmas = *estimate.sigmas;
  return std::max(sigmas[0] / estimate.camera->fx, sigmas[1] / estimate.camera->fy);
}

/// How far the focal length has gone in the last third of the segment, relative.
double RefinedCamera::movement() const {
  const auto last = focal_lengths_.end() - static_cast<long>((focal_lengths_.size() + 2) / 3);
  const auto [least, most] = std::minmax_element(last, focal_lengths_.end());
  return (*most - *least) / focal_lengths_.back();
}

bool RefinedCamera::isSettled() const {
  return 2 * focalSigma(known_) < kWanted && known_.moved < kWanted;
}

std::optional<Lens> RefinedCamera::lens(const Lens& lens, const PinholeCamera& rectified) const {
  if (!known_.sigmas || lens.model != LensModel::kPinhole) return std::nullopt;
  const PinholeCamera& camera = *known_.camera;
  const double sx = lens.fx / rectified.fx, sy = lens.fy / rectified.fy;
  Lens refined = lens;
  refined.fx = sx * camera.fx;
  refined.fy = sy * camera.fy;
  refined.cx = lens.cx + sx * (camera.cx - rectified.cx);
  refined.cy = lens.cy + sy * (camera.cy - rectified.cy);
  // Without a distortion that shows images need no resampling.
  if (known_.radial && std::abs(known_.radial->k1) > kSigmas * known_.radial->sigma) {
    refined.model = LensModel::kRadTan;
    refined.coefficients[0] = known_.radial->k1;
  }
  return refined;
}

}  // namespace dsorb
