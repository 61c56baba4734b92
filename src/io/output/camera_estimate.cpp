// SPDX-License-Identifier: BSD-3-Clause
#include "io/output/camera_estimate.h"

#include "io/output/run_json.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

namespace dsorb::io {
namespace {

constexpr double kWanted = 0.01;  // of the focal length
constexpr double kSigmas = 3;     // that a distortion or readout must differ from none by

double meanFocal(const PinholeCamera& camera) {
  return 0.5 * (camera.fx + camera.fy);
}

/// Last line of camera.txt: a readout that shows, "auto" for one that does not; none of a global
/// shutter.
std::string readoutLine(const Lens& lens) {
  const auto [seconds, sigma] = lens.readout;
  if (!lens.readout.isRolling()) return {};
  const bool shows = std::abs(seconds) > kSigmas * sigma;
  const std::string milliseconds =
      fmt::format("{:.4g}", lens.backwards ? -1000 * seconds : 1000 * seconds);
  return fmt::format(
      "readout {}{}\n", shows ? milliseconds : "auto", lens.columns ? " columns" : "");
}

}  // namespace

std::string calibrationFile(const Lens& lens) {
  const std::string numbers = fmt::format("{} {} {} {}", lens.fx, lens.fy, lens.cx, lens.cy);
  const std::string size = fmt::format("{} {}\n", lens.width, lens.height);
  const auto& k = lens.coefficients;
  const std::string model =
      lens.model == LensModel::kRadTan
          ? fmt::format("RadTan {} {} {} {} {} {}\n", numbers, k[0], k[1], k[2], k[3], k[4]) +
                size + "crop\n"
          : "Pinhole " + numbers + " 0\n" + size + "none\n";
  return model + size + readoutLine(lens);
}

void CameraEstimate::add(const KeyframeSnapshot& keyframe) {
  if (keyframe.segment != segment_) {
    focal_lengths_.clear();
    segment_ = keyframe.segment;
    frames_.clear();
  }
  if (frames_.insert(keyframe.id).second) focal_lengths_.push_back(0);
  focal_lengths_.back() = meanFocal(keyframe.camera);
  newest_ = {
      keyframe.camera, keyframe.camera_sigmas, keyframe.radial, movement(), keyframe.segment};
  const bool same_segment = known_.segment == newest_.segment;
  if (same_segment || focalSigma(newest_) <= focalSigma(known_)) known_ = newest_;
}

double CameraEstimate::focalSigma(const Estimate& estimate) {
  if (!estimate.camera || !estimate.sigmas) return std::numeric_limits<double>::infinity();
  const auto& sigmas = *estimate.sigmas;
  return std::max(sigmas[0] / estimate.camera->fx, sigmas[1] / estimate.camera->fy);
}

/// How far the focal length has gone in the last third of the segment, relative.
double CameraEstimate::movement() const {
  const auto last = focal_lengths_.end() - static_cast<long>((focal_lengths_.size() + 2) / 3);
  const auto [least, most] = std::minmax_element(last, focal_lengths_.end());
  return (*most - *least) / focal_lengths_.back();
}

/// Whether a radial distortion shows; without it images need no resampling.
bool CameraEstimate::isDistorted() const {
  return known_.radial && std::abs(known_.radial->k1) > kSigmas * known_.radial->sigma;
}

bool CameraEstimate::isSettled() const {
  return 2 * focalSigma(known_) < kWanted && known_.moved < kWanted;
}

Json CameraEstimate::json() const {
  Json json = cameraJson(*known_.camera);
  if (!known_.sigmas) return json;
  const auto& sigmas = *known_.sigmas;
  json["sigma"] = {{"fx", sigmas[0]}, {"fy", sigmas[1]}, {"cx", sigmas[2]}, {"cy", sigmas[3]}};
  if (known_.radial) {
    json["k1"] = known_.radial->k1;
    json["sigma"]["k1"] = known_.radial->sigma;
  }
  json["moved"] = known_.moved;
  json["settled"] = isSettled();
  return json;
}

std::string CameraEstimate::calibrationFile(const Lens& lens,
                                            const PinholeCamera& rectified) const {
  if (!known_.sigmas || lens.model != LensModel::kPinhole) return {};
  const PinholeCamera& camera = *known_.camera;
  const double sx = lens.fx / rectified.fx, sy = lens.fy / rectified.fy;
  Lens refined = lens;
  refined.fx = sx * camera.fx;
  refined.fy = sy * camera.fy;
  refined.cx = lens.cx + sx * (camera.cx - rectified.cx);
  refined.cy = lens.cy + sy * (camera.cy - rectified.cy);
  if (isDistorted()) {
    refined.model = LensModel::kRadTan;
    refined.coefficients[0] = known_.radial->k1;
  }
  return io::calibrationFile(refined);
}

}  // namespace dsorb::io
