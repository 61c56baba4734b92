// SPDX-License-Identifier: BSD-3-Clause
#include "window/window.h"

#include <algorithm>
#include <stdexcept>
#include <string>
#include <utility>

namespace dsorb::window {
namespace {

// Information of the priors on frames, in scaled units (window.h), as published with DSO.
constexpr double kFirstTranslation = 1e10;  // of the first keyframe, which holds the gauge
constexpr double kFirstRotation = 1e11;
constexpr double kFixedBrightness = 1e14;
constexpr double kCalibratedGain = 1e12;  // of further keyframes with calibrated brightness
constexpr double kCalibratedOffset = 1e8;

AffineBrightness affineOf(const Vector8d& state) {
  const Vector8d scaled = frameScale().cwiseProduct(state);
  return {scaled[6], scaled[7]};
}

/// Information that holds a new keyframe: the gauge for the first, brightness by what is known.
Vector8d priorOf(bool is_first, BrightnessModel brightness) {
  Vector8d prior = Vector8d::Zero();
  if (is_first) {
    prior.head<3>().setConstant(kFirstTranslation);
    prior.segment<3>(3).setConstant(kFirstRotation);
    prior.tail<2>().setConstant(kFixedBrightness);
  } else if (brightness == BrightnessModel::kPerfect) {
    prior.tail<2>().setConstant(kFixedBrightness);
  } else if (brightness == BrightnessModel::kCalibrated) {
    prior[6] = kCalibratedGain;
    prior[7] = kCalibratedOffset;
  }
  return prior;
}

void enlarge(MarginalPrior& prior, Eigen::Index size) {
  prior.H.conservativeResizeLike(Eigen::MatrixXd::Zero(size, size));
  prior.b.conservativeResizeLike(Eigen::VectorXd::Zero(size));
}

float meanInverseDepth(const Window& window) {
  float sum = 0;
  for (const Keyframe& keyframe : window.keyframes) {
    for (const WindowPoint& point : keyframe.points) sum += point.inverse_depth;
  }
  return sum / static_cast<float>(std::max<std::size_t>(window.numPoints(), 1));
}

/// Calls f with every keyframe whose image needs corrections, and with what places one of its
/// patches at an inverse depth.
template <typename F>
void forEachShutter(Window& window, F f) {
  const PinholeCamera camera = window.camera();
  for (Keyframe& keyframe : window.keyframes) {
    const std::optional<RollingShutter> shutter = window.shutter(keyframe);
    if (!shutter) continue;
    f(keyframe, [&](float inverse_depth, HostPatch& patch) {
      patch.pixel = pixelInMiddle(*shutter, camera, patch.seen, inverse_depth);
    });
  }
}

}  // namespace

void WindowPoint::addObservation(std::size_t target) {
  if (num_observations == observations.size()) {
    throw std::length_error("point has " + std::to_string(num_observations) +
                            " residuals, no room for one to keyframe " + std::to_string(target));
  }
  Observation& added = observations[num_observations++];
  added = {};
  added.target = static_cast<std::uint8_t>(target);
}

SE3 Keyframe::T_cam_world() const {
  return SE3::exp(frameScale().head<6>().cwiseProduct(state.head<6>())) * T_cam_world_first;
}

AffineBrightness Keyframe::affine() const {
  return affineOf(state);
}

AffineBrightness Keyframe::firstAffine() const {
  return affineOf(first);
}

void Keyframe::setMotion(const RowMotion& found, const MotionPrior& expected) {
  motion = found;
  first_velocity = found.velocity;
  rows = expected;
}

void Keyframe::moveFirstEstimate() {
  T_cam_world_first = T_cam_world();
  state.head<6>().setZero();
  first = state;
  first_velocity = motion.velocity;
}

PinholeCamera Window::camera() const {
  PinholeCamera camera = first_camera;
  camera.fx += kCameraScale * camera_state[0];
  camera.fy += kCameraScale * camera_state[1];
  camera.cx += kCameraScale * camera_state[2];
  camera.cy += kCameraScale * camera_state[3];
  return camera;
}

std::size_t Window::numPoints() const {
  std::size_t count = 0;
  for (const Keyframe& keyframe : keyframes) count += keyframe.points.size();
  return count;
}

Eigen::VectorXd Window::deviation() const {
  Eigen::VectorXd deviation(dimension());
  deviation.head<kCameraDim>() = camera_state;
  for (std::size_t k = 0; k < keyframes.size(); ++k) {
    const Keyframe& keyframe = keyframes[k];
    deviation.segment<kFrameDim>(rowOf(k)) = keyframe.state - keyframe.first;
    if (!hasVelocities()) continue;
    deviation.segment<kVelocityDim>(rowOf(k) + kFrameDim) =
        keyframe.velocityFrom(keyframe.first_velocity);
  }
  return deviation;
}

Keyframe& addKeyframe(Window& window,
                      const FramePtr& frame,
                      const SE3& T_cam_world,
                      const AffineBrightness& affine,
                      const WindowOptions& options) {
  const std::size_t position = window.keyframes.size();
  if (position == kMaxKeyframes) {
    throw std::length_error("window is full: " + std::to_string(position) + " keyframes");
  }
  Keyframe added;
  added.id = {window.next_keyframe++};
  added.frame = frame;
  added.T_cam_world_first = T_cam_world;
  added.state[6] = affine.a / frameScale()[6];
  added.state[7] = affine.b / frameScale()[7];
  added.first = added.state;
  added.prior = priorOf(added.id.value == 0, window.brightness);
  const bool inherits = !options.published && added.id.value > 1;
  added.energy_threshold = inherits ? window.keyframes.back().energy_threshold : kInitialThreshold;
  for (Keyframe& keyframe : window.keyframes) {
    for (WindowPoint& point : keyframe.points) {
      point.addObservation(position);
      point.recent[1] = point.recent[0];
      point.recent[0] = {added.id, ResidualState::kIn};
    }
  }
  window.keyframes.push_back(std::move(added));
  enlarge(window.prior, window.dimension());
  return window.keyframes.back();
}

void setReadout(Window& window, const std::optional<Readout>& readout) {
  if (!readout) return;
  const double change = readout->seconds - window.calibratedReadout().seconds;
  window.camera_state[kReadout] = change / kReadoutScale;
  window.readout_sigma = readout->sigma;
}

void placePoints(Window& window) {
  forEachShutter(window, [](Keyframe& keyframe, const auto& place) {
    for (WindowPoint& point : keyframe.points) place(point.inverse_depth, point.patch);
  });
}

void placeCandidates(Window& window) {
  if (window.keyframes.empty() || !window.shutter(window.keyframes.front())) return;
  const float mean = meanInverseDepth(window);
  forEachShutter(window, [mean](Keyframe& keyframe, const auto& place) {
    for (depth::CandidatePoint& candidate : keyframe.candidates) {
      place(candidate.hasDepth() ? candidate.middle() : mean, candidate.patch);
    }
  });
}

WindowPoint* addPoint(Window& window,
                      Keyframe& host,
                      const Eigen::Vector2f& pixel,
                      float inverse_depth,
                      float prior_information) {
  const auto patch = readHostPatch<interpolateWithCellGradient>(host.frame->level(0), pixel);
  if (!patch) return nullptr;
  WindowPoint point;
  point.id = {window.next_point++};
  point.inverse_depth = inverse_depth;
  point.prior_inverse_depth = inverse_depth;
  point.prior_information = prior_information;
  point.patch = *patch;
  host.points.push_back(point);
  return &host.points.back();
}

void addCandidates(Keyframe& keyframe, const std::vector<SelectedPixel>& pixels) {
  const PyramidLevel& level = keyframe.frame->level(0);
  for (const SelectedPixel& selected : pixels) {
    const Eigen::Vector2f pixel(static_cast<float>(selected.x), static_cast<float>(selected.y));
    const auto candidate = depth::makeCandidate(level, pixel, static_cast<float>(selected.type));
    if (candidate) keyframe.candidates.push_back(*candidate);
  }
}

Keyframe removeKeyframe(Window& window, std::size_t position) {
  Keyframe removed = std::move(window.keyframes[position]);
  window.keyframes.erase(window.keyframes.begin() + static_cast<std::ptrdiff_t>(position));
  for (Keyframe& keyframe : window.keyframes) {
    for (WindowPoint& point : keyframe.points) {
      point.removeObservations([&](const Observation& o) { return o.target == position; });
      for (Observation& observation : point) {
        if (observation.target > position) --observation.target;
      }
    }
  }
  return removed;
}

}  // namespace dsorb::window
